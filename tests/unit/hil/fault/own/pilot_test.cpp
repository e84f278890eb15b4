#include "hil/fault/pilot.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

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
  const std::string steers =
      text_of(scripted("title = \"t\"\n[flight]\nkind = \"manual\"\n[[pilot]]\ndo = \"steer\"\nreaction = "
                       "\"300ms\"\nsees = \"path\"\n"));
  EXPECT_THAT(steers, HasSubstr("reaction = \"300ms\"\nsees = \"path\"\n"));
  EXPECT_EQ(text_of(scripted(steers)), steers);
}

/// Along a square of 1.5 m, with the ledger so far away each way.
Metrics steered(int delay_ms, const std::string& more) {
  std::string text =
      "title = \"t\"\nmust = [\"finishes\"]\n[flight]\nkind = \"manual\"\nspeed_mps = 0.5\nlaps = 1\nseconds = 45\n"
      "max_age = \"5s\"\n[[pilot]]\ndo = \"takeoff\"\nat = \"2s\"\n"
      "[[pilot]]\ndo = \"steer\"\nat = \"flying + 1s\"\n" +
      more;
  if (delay_ms > 0) text += fmt::format("[[fault]]\nwhat = \"ledger ground delay {}ms\"\nat = \"1ms\"\n", delay_ms);
  const auto run = run_script(scripted(text), 1);
  EXPECT_TRUE(run && run->all_held()) << (run ? broken_text(*run) : run.error().message);
  return run ? run->metrics : Metrics{};
}
double off_path_m(const Metrics& metrics) {
  const auto found = std::ranges::find(metrics, "path_rms_m", &MetricValue::name);
  return found == metrics.end() ? -1 : found->value;
}

TEST(Pilot, WhoSteersBySightFollowsTheCourseAndLandsAtItsEnd) {
  const double at_once_m = off_path_m(steered(0, "reaction = \"0s\"\n")), person_m = off_path_m(steered(0, ""));
  EXPECT_GT(at_once_m, 0);
  EXPECT_LT(person_m, 0.15);
  EXPECT_GT(person_m, at_once_m) << "a reaction time costs";
}

TEST(Pilot, WhoSeesTheCommittedPathMindsADelayLess) {
  const double by_state_m = off_path_m(steered(500, "")), by_path_m = off_path_m(steered(500, "sees = \"path\"\n"));
  EXPECT_GT(by_path_m, 0);
  EXPECT_GT(by_state_m, 2 * by_path_m);
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
      {manual + "do = \"land\"\nreaction = \"1s\"\n",
       "x.toml:6: pilot.0.reaction: must be a time as 300ms, 5 s at most"},
      {manual + "do = \"steer\"\nreaction = \"6s\"\n", "x.toml:6: pilot.0.reaction: must be a time as 300ms"},
      {manual + "do = \"land\"\nsees = \"path\"\n", "x.toml:6: pilot.0.sees: goes with steer alone"},
      {manual + "do = \"steer\"\nsees = \"stars\"\n", "x.toml:6: pilot.0.sees"},
      {"title = \"t\"\n[[pilot]]\ndo = \"land\"\n", "pilot.0.do: must not be there: a pilot goes with"},
      {manual + "do = \"takeoff\"\n[[fault]]\nwhat = \"ledger stall\"\nat = \"lap 2\"\n",
       "x.toml:8: fault.0.at: must be no moment of a path: in a flight of kind \"manual\""},
  };
  for (const auto& [text, why] : cases) EXPECT_THAT(error_of(text), HasSubstr(why)) << text;
}

}  // namespace
}  // namespace ledgerline::hil
