#include "hil/fault/pilot.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hil/fault/report.hpp"
#include "hil/fault/run/run.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

using testing::HasSubstr;

constexpr const char* ahead =
    "title = \"t\"\nmust = [\"finishes\", \"takes off once\"]\n[flight]\nkind = \"manual\"\nseconds = 16\n"
    "[[pilot]]\ndo = \"takeoff\"\nat = \"2s\"\n"
    "[[pilot]]\ndo = \"fly 0.5 0 0 0\"\nat = \"flying + 1s\"\nfor = \"2s\"\n"
    "[[pilot]]\ndo = \"land\"\nat = \"flying + 6s\"\n";

TEST(Pilot, FliesAsItsRowsSay) {
  const auto run = run_script(scripted(ahead), 1);
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_TRUE(run->all_held()) << broken_text(*run);
  const TimelinePoint& last = run->timeline[0].back();
  EXPECT_NEAR(last.at_m[0], 1.0, 0.3) << "half a metre a second, for two";
  EXPECT_NEAR(last.at_m[1], 0, 0.2);
  EXPECT_LT(last.at_m[2], 0.1);
}

TEST(Pilot, TheSameWordsAndSeedGiveTheSameBytes) {
  const auto once = run_script(scripted(ahead), 3), again = run_script(scripted(ahead), 3);
  ASSERT_TRUE(once && again);
  EXPECT_EQ(once->digest, again->digest);
}

TEST(Pilot, AWordWhoseMomentNeverComesBreaksTheRun) {
  const auto run = run_script(scripted("title = \"t\"\n[flight]\nkind = \"manual\"\nseconds = 3\n"
                                       "[[pilot]]\ndo = \"land\"\nat = \"flying\"\n"),
                              1);
  ASSERT_TRUE(run);
  EXPECT_FALSE(run->all_held());
  EXPECT_THAT(broken_text(*run), HasSubstr("the pilot's \"land\" at \"flying\" never came"));
}

TEST(Pilot, IsReadAgainAsItWasWritten) {
  const std::string text = text_of(scripted(ahead));
  EXPECT_EQ(text_of(scripted(text)), text);
}

TEST(Pilot, WhatIsWrongIsReportedByLineAndKey) {
  const std::string manual = "title = \"t\"\n[flight]\nkind = \"manual\"\n[[pilot]]\n";
  const std::pair<std::string, const char*> cases[] = {
      {manual + "do = \"loop\"\n", "x.toml:5: pilot.0.do: must be takeoff"},
      {manual + "do = \"fly 1 2 3\"\n", "pilot.0.do: must be takeoff"},
      {manual + "do = \"fly 1 2 3 nan\"\n", "pilot.0.do: must be takeoff"},
      {manual + "do = \"land\"\nat = \"path\"\n", "x.toml:6: pilot.0.at: must be no moment of a path"},
      {manual + "do = \"land\"\nat = \"noon\"\n", "x.toml:6: pilot.0.at: \"noon\""},
      {manual + "do = \"land\"\nfor = \"2s\"\n", "x.toml:6: pilot.0.for: must be a time as 2s, and goes with fly"},
      {manual + "do = \"land\"\ndrone = \"tello2\"\n", "x.toml:6: pilot.0.drone: must be one that flies here"},
      {"title = \"t\"\n[[pilot]]\ndo = \"land\"\n", "pilot.0.do: must not be there: a pilot goes with"},
      {manual + "do = \"takeoff\"\n[[fault]]\nwhat = \"ledger stall\"\nat = \"lap 2\"\n",
       "x.toml:8: fault.0.at: must be no moment of a path: in a flight of kind \"manual\""},
  };
  for (const auto& [text, why] : cases) EXPECT_THAT(error_of(text), HasSubstr(why)) << text;
}

}  // namespace
}  // namespace ledgerline::hil
