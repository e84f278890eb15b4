#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/msg/cdr.hpp"
#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using testing::HasSubstr;
using Kind = fabric::Outcome::Kind;

FlightConfig manual_config(int drones) {
  FlightConfig config = config_for(drones);
  config.manual = true;
  return config;
}

PilotCommand takeoff(std::size_t drone = 0) { return {.drone = drone, .takeoff = true}; }
PilotCommand land(std::size_t drone = 0) { return {.drone = drone, .land = true}; }
PilotCommand velocity(double forward_mps, std::size_t drone = 0) {
  return {.drone = drone, .velocity = Twist{{forward_mps, 0, 0}, {}}};
}

/// In the air, and still.
struct Flying : FlightWorld {
  explicit Flying(int drones = 1) : FlightWorld(manual_config(drones)) {
    run(1);
    for (int i = 0; i < drones; ++i) say(takeoff(static_cast<std::size_t>(i)));
    run(5);
  }
};

bool is_zero(const PlannedSetpoint& s) { return s.vx() == 0 && s.vy() == 0 && s.vz() == 0 && s.yaw_rate() == 0; }

TEST(ManualFlight, StandsOnTheGroundUntilItsPilotSaysTakeOff) {
  FlightWorld world(manual_config(1));
  world.run(60);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::waiting);
  EXPECT_TRUE(world.calls.empty());
  world.say(takeoff());
  world.run(5);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
  EXPECT_EQ(world.drones[0].plans.front().action(), TAKEOFF);
}

TEST(ManualFlight, OneOfWhichNothingIsHeardDoesNotTakeOff) {
  FlightWorld world(manual_config(1));
  world.run(1);
  world.drones[0].silent = true;
  world.run(5.5);
  world.say(takeoff());
  world.run(1);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::waiting);
  EXPECT_TRUE(world.calls.empty());
  ASSERT_EQ(world.notes.size(), 1U);
  EXPECT_THAT(world.notes[0], HasSubstr("tello1: no take-off: no state came for 5.0 s"));
}

TEST(ManualFlight, HandedOverItWaitsAndHandedBackItFliesOn) {
  Flying world;
  ASSERT_TRUE(world.core.set_control(control_record("tello1", outsider_name, 2).SerializeAsString()));
  world.run(2);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::waiting);
  EXPECT_THAT(world.core.why(), HasSubstr("lost its lease to CN=User1@org3"));
  EXPECT_FALSE(world.core.ok());
  const auto before = world.drones[0].plans.size();
  world.run(2);
  EXPECT_EQ(world.drones[0].plans.size(), before);
  ASSERT_TRUE(world.core.set_control(control_record("tello1", operator_name, 3).SerializeAsString()));
  world.run(1);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
  EXPECT_GT(world.drones[0].plans.size(), before);
  EXPECT_TRUE(world.core.ok());
}

TEST(ManualFlight, HoversWithoutACommandLandsOnOneAndFliesAgain) {
  Flying world;
  for (int round = 0; round < 2; ++round) {
    const auto before = world.drones[0].plans.size();
    world.run(3);
    EXPECT_GT(world.drones[0].plans.size(), before + 60) << "a hover is commanded, not left to the failsafe";
    for (std::size_t i = before; i < world.drones[0].plans.size(); ++i) {
      for (const auto& s : world.drones[0].plans[i].setpoints()) EXPECT_TRUE(is_zero(s));
    }
    world.say(land());
    world.run(5);
    EXPECT_EQ(world.core.status(0).phase, GroundPhase::landed);
    EXPECT_EQ(world.drones[0].phase, LinkPhase::landed);
    EXPECT_FALSE(world.core.done()) << "it may take off again";
    world.say(takeoff());
    world.run(5);
    EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
  }
}

TEST(ManualFlight, AVelocityMakesAPlanAtOnceFromTheNewestState) {
  Flying world;
  world.run(0.0215);
  const auto calls = world.calls.size();
  world.say(velocity(0.3));
  ASSERT_EQ(world.calls.size(), calls + 1);
  const DronePlan& plan = world.calls.back().plans(0);
  EXPECT_EQ(plan.action(), FLY);
  EXPECT_FLOAT_EQ(plan.setpoints(0).vx(), 0.3F);
  EXPECT_LT(world.now_ns - plan.state_stamp_ns(), 100 * ns_per_ms);
  EXPECT_GE(plan.setpoints(0).at_ns(), world.now_ns - world.one_way_ns + world.core.delay_ns())
      << "the time since the state came is in it";
}

TEST(ManualFlight, APilotWhoFallsSilentLeavesADroneThatStands) {
  Flying world;
  const double start_m = world.drones[0].model.motion.position_m.x();
  for (int i = 0; i < 20; ++i) {
    world.say(velocity(0.5));
    world.run(0.1);
  }
  const double here_m = world.drones[0].model.motion.position_m.x();
  EXPECT_NEAR(here_m - start_m, 0.5 * (2 - 0.3), 0.1);
  world.run(10);
  // What was left of the last command's time, the way there, and the drone's own lag.
  EXPECT_LT(world.drones[0].model.motion.position_m.x() - here_m, 0.5 * (0.2 + 0.05 + 0.3));
  EXPECT_NEAR(world.drones[0].model.motion.velocity_mps.norm(), 0, 1e-3);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
}

TEST(ManualFlight, WhatIsSentByHandSaysWhereTheDroneWillBe) {
  for (const TimeNs one_way_ns : {5 * ns_per_ms, 300 * ns_per_ms}) {
    Flying world;
    world.one_way_ns = one_way_ns;
    for (int i = 0; i < 40; ++i) {
      world.say(velocity(0.5));
      world.run(0.1);
    }
    const auto committed = world.core.committed(world.now_ns, 0);
    ASSERT_TRUE(committed) << one_way_ns;
    ASSERT_GE(committed->points_m.size(), 2U);
    EXPECT_LE(committed->points_m.size(), CommittedPath::max_points);
    EXPECT_GE(committed->until_ns, world.core.delay_ns()) << "what is sent next comes in time to go on from it";
    // What is seen of it is as old as its state's way here.
    const Eigen::Vector3d seen_m =
        world.drones[0].model.motion.position_m - Eigen::Vector3d(0.5 * to_seconds(one_way_ns), 0, 0);
    EXPECT_LT((committed->points_m.front() - seen_m).norm(), 0.06);
    EXPECT_GT(committed->points_m.back().x() - seen_m.x(), 0.05);
    // Whatever its pilot says now, so far it comes.
    const TimeNs delay_ns = world.core.delay_ns();
    world.say({.drone = 0, .velocity = Twist{{0, 0, 0}, {}}});
    world.run(to_seconds(delay_ns - one_way_ns));
    EXPECT_LT((committed->predicted_m - world.drones[0].model.motion.position_m).norm(), 0.06) << one_way_ns;
  }
}

TEST(ManualFlight, NothingIsCommittedOnTheGroundNorWhileLinkFliesNoPlan) {
  FlightWorld world(manual_config(1));
  EXPECT_FALSE(world.core.committed(world.now_ns, 0)) << "never heard";
  world.run(1);
  EXPECT_FALSE(world.core.committed(world.now_ns, 0));
  world.say(takeoff());
  world.run(5);
  ASSERT_TRUE(world.core.committed(world.now_ns, 0)) << "it hovers, by plans";
  world.drones[0].mode = FailsafeMode::brake;
  world.run(0.2);
  EXPECT_FALSE(world.core.committed(world.now_ns, 0));
  world.drones[0].mode = FailsafeMode::none;
  world.run(0.2);
  ASSERT_TRUE(world.core.committed(world.now_ns, 0));
  EXPECT_FALSE(world.core.committed(world.now_ns + 2 * ns_per_s, 0)) << "by then all is flown";
  world.say(land());
  world.run(0.1);
  EXPECT_FALSE(world.core.committed(world.now_ns, 0)) << "it lands, whatever was sent";
  world.run(5);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_FALSE(world.core.committed(world.now_ns, 0));
}

TEST(ManualFlight, EveryPlanEndsInZero) {
  Flying world;
  for (int i = 0; i < 50; ++i) {
    world.say(velocity(0.5));
    world.run(0.02);
  }
  for (const DronePlan& plan : world.drones[0].plans) {
    if (plan.action() != FLY) continue;
    ASSERT_TRUE(is_zero(*plan.setpoints().rbegin()));
    ASSERT_LE(plan.setpoints_size(), static_cast<int>(max_setpoints));
  }
}

TEST(ManualFlight, BadValuesAreCountedAndFlyNothing) {
  Flying world;
  world.say(velocity(std::numeric_limits<double>::quiet_NaN()));
  world.say(velocity(1e9));
  world.run(1);
  EXPECT_EQ(world.core.status(0).pilot.bad_values, 2U);
  EXPECT_EQ(world.core.status(0).pilot.velocities, 0U);
  for (const auto& s : world.drones[0].plans.back().setpoints()) EXPECT_TRUE(is_zero(s));
}

TEST(ManualFlight, VelocitiesOnTheGroundAreCountedAndLeftOut) {
  FlightWorld world(manual_config(1));
  world.run(1);
  world.say(velocity(0.5));
  world.say(takeoff());
  world.say(velocity(0.5));
  world.run(0.5);
  EXPECT_EQ(world.core.status(0).pilot.not_flying, 2U);
  world.run(5);
  EXPECT_NEAR(world.drones[0].model.motion.position_m.x(), 0, 1e-6);
}

TEST(ManualFlight, SeveralDronesAreFlownEachByItsOwn) {
  Flying world(3);
  for (int i = 0; i < 10; ++i) {
    world.say(velocity(0.5, 0));
    world.say(velocity(-0.5, 2));
    world.run(0.1);
  }
  EXPECT_GT(world.drones[0].model.motion.position_m.x(), 0.2);
  EXPECT_NEAR(world.drones[1].model.motion.position_m.x(), 3, 1e-6);
  EXPECT_LT(world.drones[2].model.motion.position_m.x(), 5.8);
  world.say(land(1));
  world.run(5);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
  EXPECT_EQ(world.core.status(1).phase, GroundPhase::landed);
}

TEST(ManualFlight, NeedsNoPoseAndItsPlansAreInTheDronesFrame) {
  FlightWorld blind(manual_config(1));
  blind.drones[0].has_pose = false;
  blind.run(1);
  blind.say(takeoff());
  blind.run(1);
  EXPECT_EQ(blind.core.status(0).phase, GroundPhase::takeoff);
  ASSERT_FALSE(blind.calls.empty());
  EXPECT_EQ(blind.calls.back().plans(0).action(), TAKEOFF);
  EXPECT_TRUE(blind.calls.back().plans(0).body_frame());
}

TEST(ManualFlight, WhatLinkRefusesWithoutAPoseIsReportedAndMayBeRequestedAgain) {
  FlightWorld blind(manual_config(1));
  FlightWorld::Drone& drone = blind.drones[0];
  drone.has_pose = drone.obeys_takeoff = false;
  drone.cause = FailsafeCause::pose_lost;
  blind.run(1);
  blind.say(takeoff());
  blind.run(1.9);
  EXPECT_TRUE(blind.notes.empty()) << "earlier plans may be in flight for so long";
  blind.run(0.3);
  ASSERT_EQ(blind.notes.size(), 1U);
  EXPECT_THAT(blind.notes[0], testing::AllOf(HasSubstr("tello1: no take-off: link refuses it (its pose is lost"),
                                             HasSubstr("by_hand_without_pose")));
  EXPECT_EQ(blind.core.status(0).phase, GroundPhase::waiting);
  EXPECT_EQ(blind.core.status(0).pilot.refused, 1U);
  const auto asked = drone.plans.size();
  blind.run(1);
  EXPECT_EQ(drone.plans.size(), asked) << "it is not asked on and on";
  drone.obeys_takeoff = true;
  blind.say(takeoff());
  blind.run(5);
  EXPECT_EQ(blind.core.status(0).phase, GroundPhase::manual);
}

TEST(ManualFlight, WhatTheDroneItselfRefusesIsReportedAndMayBeRequestedAgain) {
  FlightWorld world(manual_config(1));
  FlightWorld::Drone& drone = world.drones[0];
  drone.obeys_takeoff = false;
  world.run(1);
  world.say(takeoff());
  world.run(0.2);
  drone.cause = FailsafeCause::takeoff_refused_by_drone;
  world.run(1);
  ASSERT_EQ(world.notes.size(), 1U) << "at once, before link asks the drone again";
  EXPECT_THAT(world.notes[0], HasSubstr("tello1: no take-off: the drone itself refuses to take off"));
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::waiting);
  world.say(takeoff());
  world.run(1);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::takeoff) << "what shows is the refusal of the first";
  drone.obeys_takeoff = true;
  drone.cause = FailsafeCause::none;
  world.run(5);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
}

TEST(ManualFlight, ATakeOffThatCannotBeIsRefusedAndSaysWhy) {
  FlightWorld other(manual_config(1));
  ASSERT_TRUE(other.core.set_control(control_record("tello1", outsider_name, 2).SerializeAsString()));
  other.run(1);
  for (int i = 0; i < 100; ++i) other.say(takeoff());
  ASSERT_EQ(other.notes.size(), 1U) << "a flood of commands is no flood of the log";
  EXPECT_THAT(other.notes[0], HasSubstr("its lease is held by CN=User1@org3"));
  EXPECT_EQ(other.core.status(0).pilot.refused, 100U);
}

TEST(ManualFlight, TwoRefusalsWithinASecondAreBothSaid) {
  FlightWorld world(manual_config(1));
  world.run(1);
  PilotCommand path;
  path.order.emplace();
  world.say(path);
  world.say(path);
  PilotCommand wrong;
  wrong.bad_values = 1;
  world.say(wrong);
  EXPECT_THAT(world.notes, testing::ElementsAre(HasSubstr("no path"), HasSubstr("a velocity that no drone can fly")));
}

/// Level and message of a DiagnosticArray's first status.
std::pair<int, std::string> status_in(const std::string& diagnosis) {
  CdrReader in(diagnosis);
  std::uint32_t seconds = 0, nanoseconds = 0, count = 0;
  std::uint8_t level = 0;
  std::string frame, name, message;
  in(seconds, nanoseconds, frame, count, level, name, message);
  return {level, message};
}

TEST(ManualFlight, Ros2IsToldOfAStoppedDroneThatStandsOnTheGround) {
  FlightWorld world(manual_config(1));
  world.run(1);
  EXPECT_EQ(status_in(world.diagnoses.back()), std::pair(0, std::string("may take off")));
  world.say({.drone = 0, .stop = true});
  world.run(1);
  EXPECT_EQ(status_in(world.diagnoses.back()), std::pair(2, std::string("stopped by Org2MSP CN=User1@org2")));
  const auto before = world.diagnoses.size();
  world.say(takeoff());
  world.run(5);
  ASSERT_EQ(world.diagnoses.size(), before + 1);
  EXPECT_THAT(status_in(world.diagnoses.back()).second, HasSubstr("no take-off: it is stopped by"));
}

TEST(ManualFlight, Ros2IsWarnedAsLongAsSomebodyWritesATopicAndIsNotHeard) {
  FlightWorld world(manual_config(1));
  world.unheard = {"/tello1/cmd_vel is written as another type"};
  world.run(1);
  EXPECT_EQ(status_in(world.diagnoses.back()),
            std::pair(1, std::string("may take off; /tello1/cmd_vel is written as another type")));
  world.unheard.clear();
  world.run(1);
  EXPECT_EQ(status_in(world.diagnoses.back()), std::pair(0, std::string("may take off")));
}

TEST(ManualFlight, Ros2HearsThatAStopIsCleared) {
  Flying world(1);
  world.say({.drone = 0, .stop = true});
  world.run(10);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_EQ(status_in(world.diagnoses.back()), std::pair(2, std::string("stopped by Org2MSP CN=User1@org2")));
  (void)world.core.set_control(control_record("tello1", operator_name).SerializeAsString());  // without a stop
  world.run(1);
  EXPECT_EQ(status_in(world.diagnoses.back()), std::pair(0, std::string("may take off")));
}

TEST(ManualFlight, Ros2IsToldOfARefusalForTenSecondsAndIsNotFlooded) {
  FlightWorld world(manual_config(1));
  world.run(1);
  const auto before = world.diagnoses.size();
  for (int i = 0; i < 100; ++i) world.say(velocity(0.5));
  world.say(velocity(0));
  world.run(1);
  ASSERT_EQ(world.diagnoses.size(), before + 1);
  EXPECT_THAT(status_in(world.diagnoses.back()),
              testing::Pair(1, HasSubstr("a velocity of its pilot is not flown: its flight is in phase waiting")));
  world.say(velocity(0.5));
  world.run(1);
  EXPECT_EQ(world.diagnoses.size(), before + 2) << "who tries again hears it again";
  world.run(11);
  EXPECT_EQ(status_in(world.diagnoses.back()), std::pair(0, std::string("may take off")));
}

TEST(ManualFlight, AFlightAroundAPathTakesNoTakeOffAndNoVelocityButLandsAndStops) {
  FlightWorld world(config_for(1));
  world.run(10);
  world.say(takeoff());
  world.say(velocity(0.5));
  EXPECT_THAT(world.notes.at(0), HasSubstr("it flies a path"));
  EXPECT_EQ(world.core.status(0).pilot.not_flying, 1U);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::path);
  world.say(land());
  world.run(10);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_THAT(world.core.why(), HasSubstr("landed by its pilot"));
}

TEST(ManualFlight, AStopGoesOutAtOnceAndStopsThatDroneAlone) {
  Flying world(2);
  world.say({.drone = 0, .stop = true});
  ASSERT_EQ(world.stops.size(), 1U) << "in the same step, whatever is in flight";
  EXPECT_EQ(world.stops[0].drones(0), "tello1");
  EXPECT_FALSE(world.stops[0].cut());
  EXPECT_TRUE(world.all_stops_urgent);
  world.run(5);
  EXPECT_EQ(world.stops.size(), 1U);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_EQ(world.core.status(1).phase, GroundPhase::manual);
  world.say(takeoff());
  EXPECT_THAT(world.notes.back(), HasSubstr("it is stopped by"));
}

TEST(ManualFlight, AStopIsRepeatedUntilTheLedgerHasItOrRefusesIt) {
  Flying world;
  world.end_of_stops = Kind::unavailable;
  world.say({.drone = 0, .stop = true});
  world.run(1);
  EXPECT_GT(world.stops.size(), 3U);
  EXPECT_LT(world.stops.size(), 12U) << "behind pauses";
  world.end_of_stops = Kind::committed;
  world.run(1);
  const auto said = world.stops.size();
  world.run(1);
  EXPECT_EQ(world.stops.size(), said);

  Flying other;
  other.end_of_stops = Kind::refused;
  other.say({.drone = 0, .stop = true});
  other.run(1);
  ASSERT_EQ(other.stops.size(), 2U) << "once with the count of its clears, once without";
  EXPECT_EQ(other.stops[1].clears_size(), 0);
  EXPECT_THAT(other.notes.at(0), HasSubstr("no stop: as the test wants it"));
  other.run(5);
  EXPECT_EQ(other.core.status(0).phase, GroundPhase::landed) << "its own plans land it, too";
}

TEST(ManualFlight, AStopThatIsNotOnTheLedgerInTimeIsGivenUpAloudAndTheFlightWaitsForThat) {
  Flying world;
  world.end_of_stops = Kind::unavailable;
  world.say({.drone = 0, .stop = true});
  world.run(25, "asked to land", 1);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_FALSE(world.core.done()) << "a stop waits";
  world.run(10, "asked to land", 1);
  EXPECT_TRUE(world.core.done());
  EXPECT_THAT(world.notes.back(), HasSubstr("no stop: not on the ledger within 30 s"));
}

TEST(ManualFlight, AnEmergencyCutsTheMotorsEvenBehindAStop) {
  Flying world;
  world.say({.drone = 0, .stop = true});
  world.say({.drone = 0, .cut = true});
  ASSERT_EQ(world.stops.size(), 2U);
  EXPECT_TRUE(world.stops[1].cut());
  world.say({.drone = 0, .stop = true});
  EXPECT_EQ(world.stops.size(), 2U) << "which asks for less";
}

TEST(ManualFlight, EndsWhenAskedToAndEveryDroneIsDown) {
  Flying world(2);
  world.say(land(1));
  world.run(20, "asked to land", 1);
  EXPECT_TRUE(world.core.done());
  EXPECT_TRUE(world.core.ok()) << world.core.why();
  for (const auto& drone : world.drones) EXPECT_EQ(drone.phase, LinkPhase::landed);

  FlightWorld grounded(manual_config(1));
  grounded.run(20, "asked to land", 1);
  EXPECT_TRUE(grounded.core.done());
  EXPECT_TRUE(grounded.core.ok()) << grounded.core.why();
}

TEST(ManualFlight, AStopThatLandsItNamesItsStopperAndIsAnEndAsGoodAsAnother) {
  Flying world(2);
  world.say({.drone = 0, .stop = true});
  world.say({.drone = 1, .by = crypto::IdentityName{"Org2MSP", "CN=alice"}, .stop = true});
  world.run(20, "asked to land", 5);
  EXPECT_TRUE(world.core.done());
  EXPECT_EQ(world.core.why(), "tello1: stopped by Org2MSP CN=User1@org2; tello2: stopped by Org2MSP CN=alice");
  EXPECT_TRUE(world.core.ok());

  FlightWorld along_its_path(config_for(1));
  along_its_path.run(10);
  along_its_path.say({.drone = 0, .stop = true});
  along_its_path.run(10);
  EXPECT_EQ(along_its_path.core.status(0).phase, GroundPhase::landed);
  EXPECT_FALSE(along_its_path.core.ok()) << "it did not fly its path to the end";
}

TEST(ManualFlight, EndsAfterItsTimeWhereOneIsGiven) {
  FlightConfig config = manual_config(1);
  config.seconds = 8;
  FlightWorld world(config);
  world.run(1);
  world.say(takeoff());
  world.run(60);
  EXPECT_TRUE(world.core.done());
  EXPECT_TRUE(world.core.ok()) << world.core.why();
  EXPECT_NEAR(to_seconds(world.now_ns - 1'000 * ns_per_s), 10, 0.5);
}

TEST(ManualFlight, ADroneFoundInTheAirIsHeldThere) {
  FlightWorld world(manual_config(1));
  world.drones[0].phase = LinkPhase::flying;
  world.drones[0].model.motion.stamp_ns = world.now_ns;
  world.drones[0].cause = FailsafeCause::plan_ran_out;
  world.run(1);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
  ASSERT_FALSE(world.drones[0].plans.empty());
  EXPECT_EQ(world.drones[0].plans.front().action(), FLY);
}

TEST(ManualFlight, WhatTheFailsafeLandsIsTroubleUntilTheNextTakeOff) {
  Flying world;
  world.drones[0].cause = FailsafeCause::battery_low;
  world.drones[0].phase = LinkPhase::landing;
  world.drones[0].phase_since_ns = world.now_ns;
  world.run(5);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_FALSE(world.core.ok());
  EXPECT_THAT(world.core.why(), HasSubstr("came down by itself: battery low"));
  world.drones[0].cause = FailsafeCause::none;
  world.run(1);
  world.say(takeoff());
  world.run(5);
  EXPECT_TRUE(world.core.ok());
}

TEST(ManualFlight, ACommandForAnUnknownDroneDoesNothing) {
  Flying world;
  world.say(takeoff(7));
  EXPECT_TRUE(world.notes.empty());
}

}  // namespace
}  // namespace ledgerline::ground
