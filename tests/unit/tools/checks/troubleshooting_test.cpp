#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <regex>

#include "common/base/file.hpp"
#include "common/msg/names.hpp"
#include "onboard/agent/core/command_check.hpp"
#include "onboard/link/shell/link_loop.hpp"
#include "tools/checks/core/problem.hpp"

namespace ledgerline::checks {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path source = LEDGERLINE_SOURCE;

/// One section of docs/troubleshooting.md.
std::string section(const std::string& heading) {
  const std::string page = *read_file(source / "docs/troubleshooting.md");
  const std::size_t begin = page.find("\n## " + heading + "\n");
  EXPECT_NE(begin, std::string::npos) << heading;
  return page.substr(begin, page.find("\n## ", begin + 4) - begin);
}

std::string row_of(std::string_view word) { return "\n| `" + std::string(word) + "` |"; }

TEST(Troubleshooting, HasWhatDoctorSaysInItsOwnWords) {
  EXPECT_THAT(section("What doctor says"), HasSubstr(problems_table())) << "print it again: ledgerline doctor --table";
}

TEST(Troubleshooting, HasEachCauseOfTheFailsafe) {
  const std::string text = section("Why a drone holds, lands or does not take off");
  for (std::size_t i = 1; i < enum_count<FailsafeCause>; ++i)
    EXPECT_THAT(text, HasSubstr(row_of(name(static_cast<FailsafeCause>(i)))));
}

TEST(Troubleshooting, HasEachRefusalOfAgent) {
  const std::string text = section("Why agent refuses a command");
  for (std::size_t i = 1; i < agent::refusal_count; ++i)
    EXPECT_THAT(text, HasSubstr(row_of(agent::refusal_name(static_cast<agent::RefusalReason>(i)))));
}

TEST(Troubleshooting, HasEachReasonWhyLinkDropsAPlan) {
  const std::string text = section("Why link drops a plan");
  for (std::size_t i = 1; i < enum_count<DropReason>; ++i)
    EXPECT_THAT(text, HasSubstr(row_of(link::name(static_cast<DropReason>(i)))));
}

// What a refusal of the contract begins with; shorter ones are ends of sentences, and functions' names their beginning.
TEST(Troubleshooting, HasWhatTheContractRefusesAboutDronesWith) {
  const std::string text = section("What the contract says");
  const std::regex refusal(R"re((?:Error\{|refuse\((?:Rule::\w+,\s*)?)"(?!\w+: ")([^"]{12,})")re");
  std::size_t count = 0;
  std::vector<fs::path> files{source / "chaincode/contract/command.cpp", source / "common/access/access.cpp"};
  for (const auto& entry : fs::directory_iterator(source / "chaincode/contract/control"))
    if (entry.path().extension() == ".cpp") files.push_back(entry.path());
  for (const fs::path& file : files) {
    const std::string code = *read_file(file);
    for (std::sregex_iterator match(code.begin(), code.end(), refusal), end; match != end; ++match, ++count)
      EXPECT_THAT(text, HasSubstr("`" + (*match)[1].str() + "`")) << file;
  }
  EXPECT_GT(count, 30U);
}

TEST(Troubleshooting, HasWhyAnEndorserDoesNotBeginWithASnapshot) {
  const std::string text = section("Why an endorser does not begin with a snapshot");
  // Up to the first name or number; the file is in front.
  const std::regex refusal(R"re((?:wrong\(|Error\{)[^"]*"(?:\{\}: )?([^"{]{6,}))re");
  std::size_t count = 0;
  for (const char* file : {"core/peer_snapshot.cpp", "../../common/base/file.cpp"}) {
    std::string code = *read_file(source / "chaincode/endorser" / file);
    // Of common/base/file.cpp, what OwnedFolder says.
    if (const auto open = code.find("Result<OwnedFolder>"); open != std::string::npos) {
      const auto check = code.find("Status check(");
      code = code.substr(check, code.find("\n}", check) - check) +
             code.substr(open, code.find("std::uint64_t bytes_below") - open);
    }
    for (std::sregex_iterator match(code.begin(), code.end(), refusal), end; match != end; ++match, ++count)
      EXPECT_THAT(text, HasSubstr("`" + (*match)[1].str() + "`")) << file;
  }
  EXPECT_GT(count, 15U);
}

}  // namespace
}  // namespace ledgerline::checks
