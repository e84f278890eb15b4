#include "ground/mission/check.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "common/rt/clock.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/ground/mission/missions.hpp"

namespace ledgerline::ground::mission {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

CheckConfig with_fence() {
  CheckConfig config;
  config.fence.emplace();
  return config;
}

/// Two drones on ways beside each other, both allowed.
struct MissionCheck : testing::Test {
  Mission mission{"m", {flown_by("tello1", {at(0, 0), at(5, 0)}), flown_by("tello2", {at(0, 2), at(5, 2)}, true)}};
  std::vector<DroneNow> now{standing("tello1", 0, 0), standing("tello2", 0, 2)};
  CheckConfig config = with_fence();

  std::vector<std::string> words() const {
    std::vector<std::string> words;
    for (const Finding& finding : check(mission, config, now)) words.push_back(finding.words);
    return words;
  }
  /// The only finding, which forbids the start.
  std::string forbidden() const {
    const auto findings = check(mission, config, now);
    if (findings.size() != 1) return fmt::format("{} findings", findings.size());
    return findings[0].forbids ? findings[0].words : "a warning: " + findings[0].words;
  }
};

TEST_F(MissionCheck, AGoodMissionHasNoFinding) {
  EXPECT_THAT(words(), IsEmpty());
  now[1] = hovering("tello2", 0, 2);
  EXPECT_THAT(words(), IsEmpty());
}

TEST_F(MissionCheck, Bounds) {
  mission.drones[1].drone = "tello1";
  EXPECT_EQ(forbidden(), "drone tello1 is there twice");
  mission.drones[1].drone = "tello2";
  mission.drones[1].waypoints.clear();
  EXPECT_EQ(forbidden(), "drone tello2: has 0 waypoints; 1 to 500 may be");
}

TEST_F(MissionCheck, AnUnknownDrone) {
  mission.drones[1].drone = "tello3";
  now.pop_back();
  EXPECT_EQ(forbidden(), "drone tello3: does not fly here");
}

TEST_F(MissionCheck, ADroneThatIsNotSeenOrHasNoPose) {
  now[0].at_m.reset();
  EXPECT_EQ(forbidden(), "drone tello1: has no pose: nobody knows where it is");
  now[0].seen = false;
  EXPECT_EQ(forbidden(), "drone tello1: no state came from it");
  for (const double nowhere : {std::nan(""), 1e300}) {
    now[0] = standing("tello1", nowhere, 0);
    EXPECT_EQ(forbidden(), "drone tello1: its pose is not on the map");
  }
}

TEST_F(MissionCheck, ADroneThatIsBusy) {
  now[0] = hovering("tello1", 0, 0);
  now[0].phase = GroundPhase::path;
  EXPECT_EQ(forbidden(), "drone tello1: flies a path already");
  now[0].phase = GroundPhase::landing;
  EXPECT_EQ(forbidden(), "drone tello1: is landing");
  now[0].phase = GroundPhase::failed;
  now[0].why = "lost its lease";
  EXPECT_EQ(forbidden(), "drone tello1: is in the air, and not flown from here: lost its lease");
}

TEST_F(MissionCheck, AStartThatItDoesNotStandAt) {
  mission.drones[0].start_m = Eigen::Vector2d(0.3, 0.3);
  EXPECT_THAT(words(), IsEmpty());
  mission.drones[0].start_m = Eigen::Vector2d(-1, 0);
  EXPECT_EQ(forbidden(), "drone tello1: is 1.00 m from its start; 0.5 m may be");
}

TEST_F(MissionCheck, AWaypointThatIsFarFromTheDroneOrFromAnother) {
  config.fence->min_m = {-500, -500, 0};
  config.fence->max_m = {500, 500, 3};
  config.battery_endurance_s = 1'800;
  mission.drones[0].waypoints = {at(0, 0), at(101, 0)};
  const auto findings = check(mission, config, now);
  ASSERT_THAT(findings, SizeIs(2));
  EXPECT_EQ(findings[0].words, "drone tello1, waypoint 2: is 101.0 m from where it is; 100 m may be");
  EXPECT_EQ(findings[0].waypoint, 1U);
  EXPECT_TRUE(findings[0].forbids);
  mission.drones[0].waypoints = {at(60, 0), at(-60, 0)};
  mission.drones.pop_back();
  now.pop_back();
  EXPECT_EQ(forbidden(), "drone tello1, waypoint 2: is more than 100 m from waypoint 1");
}

TEST_F(MissionCheck, TheFence) {
  mission.drones[0].waypoints.push_back(at(21, 0));
  EXPECT_EQ(forbidden(),
            "drone tello1, waypoint 3: 21, 0, 1 m is beyond the fence: x -20 to 20, y -20 to 20, z 0 to 3 m");
  mission.drones[0].waypoints.back() = at(5, 1, 3.1);
  EXPECT_THAT(forbidden(), HasSubstr("waypoint 3: 5, 1, 3.1 m is beyond the fence"));
  mission.drones[0].waypoints.back() = {{6, 0}};
  config.flight.height_m = 3.5;
  EXPECT_THAT(forbidden(), HasSubstr("waypoint 3: 6, 0, 3.5 m is beyond the fence")) << "the flight's height";
  config.flight.height_m = 1;
  config.fence->min_m[0] = 0.1;
  EXPECT_THAT(words(), testing::Contains(HasSubstr("drone tello1: its start 0, 0, 1 m is beyond the fence")));
}

TEST_F(MissionCheck, NoFenceIsAWarning) {
  config.fence.reset();
  EXPECT_EQ(forbidden(), "a warning: no fence is known here: nothing is held against it");
  EXPECT_FALSE(forbids(check(mission, config, now)));
}

TEST_F(MissionCheck, ASpeedAboveTheFlightsIsAWarning) {
  mission.drones[0].waypoints[1].speed_mps = 0.8;
  EXPECT_EQ(forbidden(), "a warning: drone tello1, waypoint 2: 0.8 m/s is flown with the flight's 0.5");
}

TEST_F(MissionCheck, TheBattery) {
  now[0].battery_share = 0.22;
  EXPECT_EQ(forbidden(), "drone tello1: has 22 % of its battery and needs 23 %: 22 s of 780 s, and 20 % in reserve");
  now[0].battery_share.reset();
  EXPECT_EQ(forbidden(), "drone tello1: its battery is not known");
  now[0].battery_share = 1;
  mission.drones[0].waypoints.clear();
  for (int i = 0; i < 30; ++i) mission.drones[0].waypoints.push_back(at(i % 2 == 0 ? 15 : 0, 0));
  EXPECT_EQ(forbidden(), "drone tello1: its path takes longer than the 780 s of a battery");
}

TEST_F(MissionCheck, PathsThatMeet) {
  mission.drones[0].waypoints.push_back(at(5, 2));
  const auto findings = check(mission, config, now);
  ASSERT_THAT(findings, SizeIs(1));
  EXPECT_TRUE(findings[0].forbids);
  EXPECT_EQ(findings[0].drone, "tello1");
  EXPECT_EQ(findings[0].waypoint, 2U);
  EXPECT_THAT(findings[0].words, HasSubstr("m from tello2"));
}

TEST_F(MissionCheck, StartsThatAreTooNear) {
  now[1].at_m->y() = 0.5;
  EXPECT_THAT(forbidden(), HasSubstr("drone tello1: at the start it is 0.50 m from tello2"));
}

TEST_F(MissionCheck, AnotherThatIsRunningMayBeAnywhereOnItsPath) {
  now.push_back(hovering("tello3", 10, -3, 1.2));
  EXPECT_THAT(words(), IsEmpty());
  now.back().phase = GroundPhase::path;
  now.back().way = {{10, 3, 1.2}, {-10, 3, 1.2}};
  EXPECT_THAT(words(), IsEmpty());
  now.back().way.push_back({-10, -10, 1.2});
  now.back().way.push_back({10, 0.1, 1.2});
  EXPECT_FALSE(forbidden().empty());
  now.back().way.resize(200, {10, 3, 1.2});
  EXPECT_THAT(forbidden(), HasSubstr("too long to be held against"));
  now.back().at_m.reset();
  EXPECT_THAT(forbidden(), HasSubstr("nobody knows where"));
}

TEST_F(MissionCheck, ADroneWithoutAPartInItKeepsItsPlace) {
  now.push_back(hovering("tello3", 3, 0.2));
  EXPECT_THAT(forbidden(), HasSubstr("m from tello3 and 0.00 m in height, which then stays"));
  now.back() = hovering("tello3", 3, 0.2, 2);
  EXPECT_THAT(words(), IsEmpty()) << "above the path";
  now.back() = hovering("tello3", 0, 0, 1.2);
  EXPECT_THAT(forbidden(), HasSubstr("at the start it is 0.00 m from tello3")) << "in the way of the take-off";
  now.back() = hovering("tello3", 0, 0, 0.2);
  EXPECT_THAT(forbidden(), HasSubstr("at the start it is 0.00 m from tello3")) << "in the column that it rises in";
  now.push_back(hovering("tello4", 0, 0, 0.3));
  EXPECT_THAT(words(), SizeIs(2)) << "two that have no part in it are nobody's concern";
}

TEST_F(MissionCheck, SettingsThatMakeNoSenseForbidIt) {
  config.battery_endurance_s = 1e9;
  EXPECT_EQ(forbidden(), "not checked: battery_endurance_s must be from 60 to 1800");
  config = with_fence();
  config.apart.level_m = -1;
  EXPECT_THAT(forbidden(), HasSubstr("not checked: drones must be apart"));
}

TEST_F(MissionCheck, FindingsAreBounded) {
  for (Waypoint& waypoint : mission.drones[0].waypoints) waypoint.speed_mps = 0.8;
  for (int i = 0; i < 300; ++i) mission.drones[0].waypoints.push_back(at(i % 2 == 0 ? 0 : 0.1, 0, 1, 0.8));
  auto findings = check(mission, config, now);
  ASSERT_THAT(findings, SizeIs(max_findings));
  EXPECT_EQ(findings.back().words, "and 103 more findings");
  EXPECT_FALSE(findings.back().forbids) << "warnings all of them";
  mission.drones[0].waypoints.push_back(at(30, 0));
  findings = check(mission, config, now);
  EXPECT_TRUE(findings.back().forbids) << "one of those that are not reported";
}

// What check() lets pass FlightCore flies.
TEST_F(MissionCheck, WhatPassesIsAllowedByTheFlightsOwnRule) {
  mission.drones.pop_back();
  now.pop_back();
  config.fence.reset();
  config.battery_endurance_s = 1'800;
  config.battery_reserve = 0;
  int passed = 0;
  for (int seed = 1; seed <= seeds(100, 2'000); ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    auto& way = mission.drones[0].waypoints;
    way.clear();
    for (std::size_t n = 1 + below(random, 4); n-- > 0;)
      way.push_back(at(between(random, -80, 80), between(random, -80, 80), between(random, 0.2, 5)));
    if (forbids(check(mission, config, now))) continue;
    ++passed;
    EXPECT_TRUE(motion::check_way(way, now[0].at_m->head<2>())) << seed;
    for (const Waypoint& from : way) EXPECT_TRUE(motion::check_way(way, from.at_m)) << seed;
  }
  EXPECT_GT(passed, 10);
}

/// 64 drones in 8 rows of 8, 500 waypoints each, on ways that `way_of` makes from where each one stands.
template <typename WayOf>
std::vector<Finding> check_largest(double row_m, WayOf way_of) {
  Mission mission{"largest", {}};
  std::vector<DroneNow> now;
  for (int i = 0; i < 64; ++i) {
    const std::string name = fmt::format("tello{}", i);
    const double x = row_m * (i % 8) - 15, y = row_m * (i / 8) - 15;
    mission.drones.push_back(flown_by(name, way_of(x, y)));
    now.push_back(standing(name, x, y));
  }
  CheckConfig config = with_fence();
  config.flight.speed_mps = 1;
  config.battery_endurance_s = 1'800;
  config.battery_reserve = 0;
  const TimeNs start = read_clock(CLOCK_THREAD_CPUTIME_ID);  // others may be busy here
  auto findings = check(mission, config, now);
  const double took_s = to_seconds(read_clock(CLOCK_THREAD_CPUTIME_ID) - start);
  std::printf("[  took    ] %.3f s of processor time\n", took_s);
  if (!slow) {
    EXPECT_LT(took_s, 1);
  }
  return findings;
}

TEST(MissionCheckOfAll, SixtyFourDronesOfFiveHundredWaypointsAreCheckedInASecond) {
  Random random(7);
  const auto findings = check_largest(4, [&](double x, double y) {
    std::vector<Waypoint> way;
    for (int k = 0; k < 500; ++k)
      way.push_back(
          at(x + 1.7 * (k % 2) + between(random, 0, 1.5), y + between(random, 0, 3.2), between(random, 0.5, 2.5), 1));
    return way;
  });
  EXPECT_FALSE(forbids(findings)) << findings.front().words;
}

// All fly one way, each beside the next: no box or line round a part of it is away from those round the others'.
TEST(MissionCheckOfAll, WhoAreCloseToEachOtherAllTheTimeAreCheckedInASecondAsWell) {
  const auto findings = check_largest(3, [&](double x, double y) {
    Random random(7);
    std::vector<Waypoint> way;
    for (int k = 0; k < 500; ++k)
      way.push_back(
          at(x + 1.2 * (k % 2) + between(random, 0, 0.7), y + between(random, 0, 1.9), between(random, 0.5, 2.5), 1));
    return way;
  });
  EXPECT_FALSE(forbids(findings)) << findings.front().words;
  Random random(9);
  const auto mixed = check_largest(0.7, [&](double x, double y) {
    std::vector<Waypoint> way;
    for (int k = 0; k < 500; ++k)
      way.push_back(at(x + 20 * (k % 2) + between(random, 0, 3), y + between(random, 0, 15), 1, 1));
    return way;
  });
  EXPECT_TRUE(forbids(mixed));
}

}  // namespace
}  // namespace ledgerline::ground::mission
