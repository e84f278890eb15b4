#include "hil/fault/script.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "hil/fault/run/run.hpp"
#include "tests/unit/hil/fault/scripts.hpp"

namespace ledgerline::hil {
namespace {

using testing::HasSubstr;

constexpr const char* two_tasks =
    "title = \"t\"\n[flight]\ndrones = 3\nshape = \"triangle\"\nside_m = 1\n"
    "[[task]]\ndrone = \"tello2\"\nwaypoints = [\"0,0\", \"1,0,1.4\", \"1,1.2,,0.3\", \"-2,1\"]\nlaps = 2\n"
    "[[task]]\ndrone = \"tello3\"\nspeed_mps = 0.25\n";

TEST(Course, EachDroneHasItsOwnAndTheRestIsTheFlights) {
  const Script script = scripted(two_tasks);
  const ground::Task first = task_of(script.flight, 1), second = task_of(script.flight, 2),
                     third = task_of(script.flight, 3);
  EXPECT_EQ(first.shape, ground::Shape::triangle);
  EXPECT_EQ(first.laps, 1);
  ASSERT_EQ(second.waypoints.size(), 4U);
  EXPECT_EQ(second.waypoints[1].height_m, 1.4);
  EXPECT_FALSE(second.waypoints[2].height_m);
  EXPECT_EQ(second.waypoints[2].speed_mps, 0.3);
  EXPECT_EQ(second.laps, 2);
  EXPECT_EQ(third.shape, ground::Shape::triangle);
  EXPECT_EQ(third.side_m, 1);
  EXPECT_EQ(third.speed_mps, 0.25);
}

TEST(Course, IsReadAgainAsItWasWritten) {
  const std::string text = text_of(scripted(two_tasks));
  EXPECT_EQ(text_of(scripted(text)), text);
  EXPECT_THAT(text, HasSubstr("  \"1,1.2,,0.3\",\n"));
}

TEST(Course, AFileOfWaypointsLiesBesideTheScript) {
  const std::string folder = testing::TempDir();
  std::ofstream(folder + "/my_way.csv") << "x,y\n0,0\n2,0\n2,2\n";
  const auto script = parse_script("title = \"t\"\n[flight]\nshape = \"my_way.csv\"\n", folder + "/my.toml");
  ASSERT_TRUE(script) << script.error().message;
  EXPECT_EQ(script->flight.waypoints.size(), 3U);
  const std::string text = text_of(*script);
  EXPECT_EQ(text_of(scripted(text)), text) << "the file is not needed any more";
}

TEST(Course, WhatIsWrongIsReportedByLineAndKey) {
  const std::pair<std::string, const char*> cases[] = {
      {"[flight]\nshape = \"circle\"\n", "x.toml:3: flight.shape: \"circle\" is none of square"},
      {"[flight]\nwaypoints = [\"0,0\", \"1,0\"]\n", "x.toml:3: flight.waypoints: must be rows"},
      {"[flight]\nwaypoints = [\"0,0\", \"1,0\", \"1,up\"]\n", "row:3: y \"up\" is no number"},
      {"[flight]\nshape = \"x\"\nwaypoints = [\"0,0\", \"1,0\", \"1,1\"]\n", "must not be there beside a shape"},
      {"[[task]]\ndrone = \"tello2\"\n", "x.toml:3: task.0.drone: must be one that flies here: tello1 to tello1"},
      {"[[task]]\ndrone = \"tello1\"\n[[task]]\ndrone = \"tello1\"\n", "x.toml:5: task.1.drone: must be another one"},
      {"[[task]]\ndrone = \"tello1\"\nlaps = 0\n", "x.toml:4: task.0.laps: must be a whole number from 1"},
      {"[[task]]\ndrone = \"tello1\"\nheight = 2\n", "x.toml:4: task.0.height: unknown key"},
      {"[flight]\nseconds = 9\n", "x.toml:3: flight.seconds: must not be there"},
  };
  for (const auto& [text, why] : cases) EXPECT_THAT(error_of("title = \"t\"\n" + text), HasSubstr(why)) << text;
}

TEST(Course, LimitsReachAsFarAsTheCourseDoes) {
  const Script script = scripted(two_tasks);
  std::vector<DroneObservation> drones(3);
  drones[1].start_m = {2, 0};
  const Limits limits = limits_of(script, drones);
  EXPECT_DOUBLE_EQ(limits.fence_min_m[0], -3);  // tello2 gets back to x = 0
  EXPECT_DOUBLE_EQ(limits.fence_max_m[0], 2 + 1 + 3);
  const Script far = scripted("title = \"t\"\n[flight]\nwaypoints = [\"0,0\", \"-5,0,2\", \"-5,-4\"]\n");
  const Limits beyond = limits_of(far, std::vector<DroneObservation>(1));
  EXPECT_DOUBLE_EQ(beyond.fence_min_m[0], -8);
  EXPECT_DOUBLE_EQ(beyond.fence_min_m[1], -7);
  EXPECT_EQ(far.must[0].text, "height below 2.6 m") << "it is asked to fly at 2 m";
}

TEST(Course, ACornerThatIsNotFlownBreaksItsRule) {
  const std::string must = "title = \"t\"\nmust = [\"finishes\", \"corners within 0.3 m\"]\n";
  const auto held = run_script(scripted(must + "[flight]\nside_m = 1\nlaps = 2\n"), 1);
  ASSERT_TRUE(held) << held.error().message;
  EXPECT_TRUE(held->all_held());
  const auto missed = run_script(
      scripted(must + "[flight]\nside_m = 1\n[[fault]]\nwhat = \"operator stop tello1\"\nat = \"path + 1s\"\n"), 1);
  ASSERT_TRUE(missed);
  EXPECT_FALSE(missed->verdicts[1].held);
  EXPECT_THAT(missed->verdicts[1].what, HasSubstr("tello1: "));
}

}  // namespace
}  // namespace ledgerline::hil
