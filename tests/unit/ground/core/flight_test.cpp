#include "ground/core/flight.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(Flight, DronesTakeOffFlyTheirLapsAndLand) {
  FlightConfig config = config_for(3);
  config.laps = 2;
  FlightWorld world(config);
  world.run(120);
  EXPECT_TRUE(world.core.done());
  EXPECT_TRUE(world.core.ok()) << world.core.why();
  for (std::size_t i = 0; i < 3; ++i) {
    const FlightStatus status = world.core.status(i);
    EXPECT_EQ(status.phase, GroundPhase::landed);
    ASSERT_EQ(status.lap_s.size(), 2u);
    for (double lap_s : status.lap_s) EXPECT_NEAR(lap_s, 13, 1.5);
    EXPECT_EQ(world.drones[i].phase, LinkPhase::landed);
    EXPECT_GT(status.path_ns[1] - status.path_ns[0], 22 * ns_per_s);
  }
}

TEST(Flight, EachPathBeginsWhereItsDroneStood) {
  FlightWorld world(config_for(2));
  world.run(20);
  EXPECT_NEAR(world.core.status(0).origin_m[0], 0, 1e-9);
  EXPECT_NEAR(world.core.status(1).origin_m[0], 3, 1e-9);
  EXPECT_NEAR(world.core.status(1).origin_m[1], 1, 1e-9);
}

TEST(Flight, WhatAPlugInSendsIsCommitted) {
  FlightConfig config = config_for(1);
  config.follower = [](const FollowerTask& task, const ControllerConfig& with) -> Result<std::unique_ptr<Follower>> {
    return std::unique_ptr<Follower>(
        std::make_unique<PathController>(task.waypoints, task.origin_m, with, task.yaw_rad));
  };
  FlightWorld world(config);
  world.run(12);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::path);
  ASSERT_EQ(world.core.controller(0), nullptr);
  const auto committed = world.core.committed(world.now_ns, 0);
  ASSERT_TRUE(committed);
  EXPECT_LT((committed->points_m.front() - world.drones[0].model.motion.position_m).norm(), 0.05);
  EXPECT_GT((committed->points_m.back() - committed->points_m.front()).norm(), 0.1);
}

TEST(Flight, PhasesComeInOrder) {
  FlightWorld world(config_for(1));
  std::vector<GroundPhase> seen{world.core.status(0).phase};
  while (!world.core.done() && world.now_ns < 1'200 * ns_per_s) {
    world.run(0.02);
    if (world.core.status(0).phase != seen.back()) seen.push_back(world.core.status(0).phase);
  }
  EXPECT_THAT(seen, testing::ElementsAre(GroundPhase::waiting, GroundPhase::takeoff, GroundPhase::path,
                                         GroundPhase::landing, GroundPhase::landed));
}

TEST(Flight, FliesForSecondsWhereAskedTo) {
  FlightConfig config = config_for(1);
  config.seconds = 7;
  FlightWorld world(config);
  world.run(60);
  EXPECT_TRUE(world.core.ok()) << world.core.why();
  EXPECT_TRUE(world.core.status(0).lap_s.empty());
  EXPECT_NEAR(to_seconds(world.core.status(0).path_ns[1] - world.core.status(0).path_ns[0]), 7, 0.1);
}

TEST(Flight, SameInputsGiveTheSameOutputs) {
  FlightWorld one(config_for(2)), two(config_for(2));
  one.run(30);
  two.run(30);
  ASSERT_EQ(one.calls.size(), two.calls.size());
  for (std::size_t i = 0; i < one.calls.size(); ++i) {
    EXPECT_EQ(one.calls[i].SerializeAsString(), two.calls[i].SerializeAsString());
  }
}

TEST(Flight, ARequestToLandLandsEveryDroneAndIsNoSuccess) {
  FlightWorld world(config_for(2));
  world.run(60, "asked to land", 10);
  EXPECT_TRUE(world.core.done());
  EXPECT_FALSE(world.core.ok());
  EXPECT_THAT(world.core.why(), HasSubstr("tello2: asked to land"));
  for (const auto& drone : world.drones) EXPECT_EQ(drone.phase, LinkPhase::landed);
}

TEST(Flight, ARequestToLandBeforeTakeOffLeavesTheDroneOnTheGround) {
  FlightWorld world(config_for(1));
  world.drones[0].has_pose = false;
  world.run(60, "asked to land", 2);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::failed);
  EXPECT_TRUE(world.calls.empty());
}

TEST(Flight, WaitingTooLongNamesWhatIsMissing) {
  FlightWorld silent(config_for(1));
  silent.drones[0].silent = true;
  silent.run(60);
  EXPECT_EQ(silent.core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(silent.core.why(), HasSubstr("no state came through the ledger within 30 s"));

  FlightWorld blind(config_for(1));
  blind.drones[0].has_pose = false;
  blind.run(60);
  EXPECT_THAT(blind.core.why(), HasSubstr("it has no pose"));

  FlightWorld empty(config_for(1));
  empty.drones[0].cause = FailsafeCause::battery_low;
  empty.run(60);
  EXPECT_THAT(empty.core.why(), HasSubstr("it may not take off (battery low)"));
  EXPECT_TRUE(empty.calls.empty());  // what link would refuse is not asked

  FlightWorld other(config_for(1));
  ASSERT_TRUE(other.core.set_control(control_record("tello1", outsider_name, 2).SerializeAsString()));
  other.run(60);
  EXPECT_THAT(other.core.why(), HasSubstr("its lease is held by CN=User1@org3"));
}

TEST(Flight, ADroneThatDoesNotTakeOffIsGivenUp) {
  FlightWorld world(config_for(1));
  world.drones[0].obeys_takeoff = false;
  world.run(90);
  EXPECT_TRUE(world.core.done());
  EXPECT_FALSE(world.core.ok());
  EXPECT_THAT(world.core.why(), HasSubstr("did not take off within 25 s"));
}

TEST(Flight, SilenceInTheAirEndsInLandingAndThenInFailure) {
  FlightWorld world(config_for(1));
  world.run(10);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::path);
  world.drones[0].silent = true;
  world.run(5.5);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landing);
  EXPECT_THAT(world.core.why(), HasSubstr("no state came for 5.0 s"));
  world.run(30);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(world.core.why(), HasSubstr("was not seen to land within 20 s"));
}

TEST(Flight, ASilenceIsWarnedOfAndSaysWhetherTheLedgerIsSilentToo) {
  for (const int drones : {1, 2}) {
    FlightWorld world(config_for(drones));
    world.run(10);
    ASSERT_EQ(world.core.status(0).phase, GroundPhase::path);
    const std::string who = drones == 1 ? "s, nor any block" : "s, though blocks come";
    world.drones[0].silent = true;
    world.run(2);
    ASSERT_EQ(world.notes.size(), 1U);
    EXPECT_THAT(world.notes[0], HasSubstr("tello1: no state came for 1.0 " + who));
    world.run(3.5);
    EXPECT_THAT(world.core.why(), HasSubstr("no state came for 5.0 " + who));
  }
}

TEST(Flight, ALinkThatIsStartedAgainInTheAirIsWaitedForAndFlownOn) {
  FlightWorld world(config_for(1));
  world.run(10);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::path);
  world.drones[0].boot_id = 8;
  world.drones[0].sequence = 0;
  world.drones[0].phase = LinkPhase::disconnected;  // it has yet to find its drone
  world.run(1);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::path);
  world.drones[0].phase = LinkPhase::flying;
  world.run(60);
  EXPECT_TRUE(world.core.ok()) << world.core.why();
  EXPECT_EQ(world.drones[0].plans.back().boot_id(), 8U);
}

TEST(Flight, ALinkThatDoesNotFindItsDroneAgainIsSilence) {
  FlightWorld world(config_for(1));
  world.run(10);
  world.drones[0].boot_id = 8;
  world.drones[0].phase = LinkPhase::disconnected;
  world.run(5.5);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landing);
  EXPECT_THAT(world.core.why(), HasSubstr("no state came for 5.0 s"));
}

TEST(Flight, ADroneThatDoesNotLandFails) {
  FlightWorld world(config_for(1));
  world.drones[0].obeys_landing = false;
  world.run(90);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(world.core.why(), HasSubstr("was not seen to land"));
}

TEST(Flight, AHeldBackDroneIsLandedWhenItsTimeIsUp) {
  FlightConfig config = config_for(1);
  config.limits.path_factor = 0;
  config.controller.speed_mps = 0.06;
  FlightWorld world(config);
  world.run(120);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_THAT(world.core.why(), HasSubstr("did not finish its path within 30 s"));
}

TEST(Flight, ADroneThatComesDownByItselfIsReportedWithItsCause) {
  FlightWorld world(config_for(1));
  world.run(10);
  world.drones[0].cause = FailsafeCause::battery_critical;
  world.drones[0].phase = LinkPhase::landing;
  world.drones[0].phase_since_ns = world.now_ns;
  world.run(30);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landed);
  EXPECT_FALSE(world.core.status(0).finished);
  EXPECT_THAT(world.core.why(), HasSubstr("came down by itself: battery critical"));
}

TEST(Flight, ADroneThatLinkLosesIsNotSaidToHaveComeDown) {
  FlightWorld world(config_for(1));
  world.run(10);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::path);
  world.drones[0].obeys_landing = false;
  world.drones[0].cause = FailsafeCause::state_stale;
  world.drones[0].mode = FailsafeMode::land;
  world.run(30);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(world.core.why(), HasSubstr("lost: link had no more state of it, last at "));
  EXPECT_THAT(world.core.why(), HasSubstr("m; was not seen to land within 20 s"));
  EXPECT_THAT(world.core.why(), Not(HasSubstr("landed it")));
}

TEST(Flight, WhoeverElseLandedItIsNotCalledItself) {
  FlightWorld world(config_for(1));
  world.run(10);
  world.drones[0].phase = LinkPhase::landing;
  world.drones[0].phase_since_ns = world.now_ns;
  world.run(30);
  EXPECT_THAT(world.core.why(), HasSubstr("landed without an order of ours"));
}

TEST(Flight, OneDronesTroubleLeavesTheOthersFlying) {
  FlightWorld world(config_for(3));
  world.drones[1].obeys_takeoff = false;
  world.run(120);
  EXPECT_TRUE(world.core.status(0).finished);
  EXPECT_FALSE(world.core.status(1).finished);
  EXPECT_TRUE(world.core.status(2).finished);
  EXPECT_FALSE(world.core.ok());
}

}  // namespace
}  // namespace ledgerline::ground
