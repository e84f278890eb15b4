#include "hil/fault/scenarios.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "common/base/file.hpp"

namespace ledgerline::hil {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

/// A folder like one where the program is installed, and one like a source tree.
class Scenarios : public testing::Test {
 protected:
  Scenarios() { fs::remove_all(root_); }
  ~Scenarios() override { fs::remove_all(root_); }
  std::string file(const std::string& path) {
    EXPECT_TRUE(write_file((root_ / path).string(), "").ok());
    return (root_ / path).string();
  }
  std::string at(const std::string& path) const { return (root_ / path).string(); }

  fs::path root_ = fs::path(testing::TempDir()) / "ledgerline_scenarios";
};

TEST_F(Scenarios, AreBesideTheProgramElseInTheTreeItWasBuiltIn) {
  fs::create_directories(at("tree/build/release/bin"));
  EXPECT_THAT(scenario_folder(at("tree/build/release")).error().message, HasSubstr("neither in"));
  file("tree/hil/scenarios/flight/a.toml");
  EXPECT_EQ(*scenario_folder(at("tree/build/release")), at("tree/hil/scenarios"));
  file("tree/build/release/share/ledgerline/scenarios/flight/a.toml");
  EXPECT_EQ(*scenario_folder(at("tree/build/release")), at("tree/build/release/share/ledgerline/scenarios"));
  EXPECT_FALSE(scenario_folder("").ok());
}

TEST_F(Scenarios, AreNamedByFileFolderScenarioOrGroup) {
  const std::string opt = at("opt");
  const std::string a = file("opt/share/ledgerline/scenarios/flight/a.toml"),
                    b = file("opt/share/ledgerline/scenarios/flight/b.toml"),
                    c = file("opt/share/ledgerline/scenarios/ledger/c.toml"), mine = file("mine/d.toml");
  file("mine/notes.txt");
  EXPECT_THAT(*scripts_named({"c"}, opt), ElementsAre(c));
  EXPECT_THAT(*scripts_named({"flight"}, opt), ElementsAre(a, b));
  EXPECT_THAT(*scripts_named({"all"}, opt), ElementsAre(a, b, c));
  EXPECT_THAT(*scripts_named({at("mine")}, opt), ElementsAre(mine));
  EXPECT_THAT(*scripts_named({mine, "a", "flight"}, opt), ElementsAre(mine, a, b));
  const auto none = scripts_named({"wings"}, opt);
  ASSERT_FALSE(none.ok());
  EXPECT_THAT(none.error().message, HasSubstr("there is no file wings, and no scenario or group of this name in"));
  EXPECT_THAT(scripts_named({"fligt"}, opt).error().message, HasSubstr("(did you mean flight? "));
  EXPECT_THAT(scripts_named({"wings"}, at("elsewhere")).error().message, HasSubstr("neither in"));
  fs::create_directories(at("empty"));
  EXPECT_THAT(scripts_named({at("empty")}, opt).error().message, HasSubstr("there is no *.toml in"));
  EXPECT_EQ(group_of(c, at("opt/share/ledgerline/scenarios")), "ledger");
  EXPECT_EQ(name_of_script(c), "c");
}

}  // namespace
}  // namespace ledgerline::hil
