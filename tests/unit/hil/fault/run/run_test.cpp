#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "common/base/file.hpp"
#include "hil/fault/random_script.hpp"
#include "hil/fault/report.hpp"
#include "hil/fault/run/run.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

RunResult flown(const Script& script, std::uint64_t seed) {
  auto result = run_script(script, seed);
  EXPECT_TRUE(result.ok()) << result.error().message;
  return result ? std::move(*result) : RunResult{};
}

std::string json_of(const RunResult& result) { return json_text({result}, {summary_of(result, "")}); }

TEST(FaultRun, TheSameSeedGivesTheSameVerdictAndTheSameBytes) {
  for (int number = 1; number <= seeds(slow ? 1 : 3, 100); ++number) {
    const Script script = draw_script(static_cast<std::uint64_t>(number) + 100'000);
    const RunResult first = flown(script, 7), second = flown(script, 7);
    EXPECT_EQ(first.digest, second.digest) << script.name;
    EXPECT_EQ(json_of(first), json_of(second)) << script.name;
    if (slow || number > 2) continue;
    EXPECT_NE(first.digest, flown(script, 8).digest) << script.name;
  }
}

TEST(FaultRun, ABrokenRuleIsReportedWithItsMomentInEveryForm) {
  const Script script = scripted(
      "title = \"Not <so>\"\nmust = [\"height below 0.5 m\", \"no crash\"]\n[[fault]]\nwhat = \"operator stop "
      "tello1\"\n"
      "at = \"height 0.8\"\n");
  const RunResult result = flown(script, 1);
  EXPECT_FALSE(result.all_held());
  EXPECT_NE(broken_text(result).find("height below 0.5 m: tello1: 0.50"), std::string::npos) << broken_text(result);
  EXPECT_NE(json_of(result).find("\"rule\": \"height below 0.5 m\""), std::string::npos);
  EXPECT_NE(json_of(result).find("\"broken\": 1"), std::string::npos);
  const std::string junit = junit_text({result}, {summary_of(result, "")});
  EXPECT_NE(junit.find("failures=\"1\""), std::string::npos);
  EXPECT_NE(junit.find("message=\"Not &lt;so&gt;\""), std::string::npos);
  const std::string html = html_text({result}, {summary_of(result, "")});
  EXPECT_NE(html.find("height below 0.5 m"), std::string::npos);
  EXPECT_EQ(html.find("Not <so>"), std::string::npos);
  EXPECT_NE(html.find("A simulated run flies the same again"), std::string::npos) << "a real one does not";
  EXPECT_EQ(html.find("@DATA@"), std::string::npos);
}

TEST(FaultRun, BreaksOnAHeightAndACrashThatNobodyForbade) {
  const std::string up = "title = \"t\"\n[[fault]]\nwhat = \"drone tello1 kick 0 0 6\"\n";
  EXPECT_NE(broken_text(flown(scripted(up), 1)).find("height below 1.6 m"), std::string::npos);
  // As a drone turns over: without the fault that may do so, it is a crash.
  Script script = scripted("title = \"t\"\n[[fault]]\nwhat = \"drone tello1 propeller\"\n");
  EXPECT_EQ(broken_text(flown(script, 1)).find("always: no crash"), std::string::npos);
  script.faults[0].acts.breaks = false;
  EXPECT_NE(broken_text(flown(script, 1)).find("always: no crash: tello1 turned over"), std::string::npos);
}

TEST(FaultRun, ARecordedDayIsPlayedAsItWentOn) {
  const std::string file = std::filesystem::temp_directory_path() / ("day-" + std::to_string(::getpid()) + ".csv");
  const auto seen_stale = [&](const std::string& table, const std::string& offset) {
    EXPECT_TRUE(write_file(file, table));
    const Script script = scripted(
        "title = \"t\"\nmust = [\"state stale is seen\"]\n[[fault]]\nwhat = \"drone tello1 states recorded-day " +
        file + offset + "\"\nat = \"path + 1s\"\nfor = \"4s\"\n");
    const RunResult result = flown(script, 3);
    EXPECT_EQ(result.digest, flown(script, 3).digest);
    return result.all_held();
  };
  const std::string lost_later = "0,0.02\n2,lost\n4,0.02\n60,0.02\n";
  EXPECT_TRUE(seen_stale(lost_later, ""));
  EXPECT_FALSE(seen_stale(lost_later, " at 5s")) << "what was lost is over by then";
  std::filesystem::remove(file);
}

TEST(FaultRun, WhoseFaultNeverCameHasNotHeld) {
  for (const char* optional : {"", "optional = true\n"}) {
    const RunResult result = flown(
        scripted(std::string("title = \"t\"\n[[fault]]\nwhat = \"ledger stall\"\nat = \"height 50\"\n") + optional), 1);
    EXPECT_EQ(result.all_held(), *optional != '\0');
    EXPECT_EQ(broken_text(result).find("\"ledger stall\" at height 50 never began") != std::string::npos,
              *optional == '\0');
  }
}

TEST(FaultRun, WaitsForTheStartOfWhatItKilled) {
  const RunResult result =
      flown(scripted("title = \"t\"\n[[fault]]\nwhat = \"ground kill\"\nat = \"path\"\nfor = \"40s\"\n"), 1);
  EXPECT_TRUE(result.over);
  EXPECT_GT(result.flown_ns, 40 * ns_per_s);
}

}  // namespace
}  // namespace ledgerline::hil
