#include <gtest/gtest.h>

#include <algorithm>

#include "tests/unit/onboard/link/core/link_world.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

/// Plans in the drone's own frame.
namespace ledgerline::link {
namespace {

LinkSettings free_by_hand(LinkSettings settings = {}) {
  settings.drones.push_back({.name = "tello1", .number = 1, .by_hand_without_pose = true});
  return settings;
}

void take_off_by_hand(LinkWorld& world) {
  world.pass(ns_per_s);
  world.plan(PlanAction::takeoff).body_frame = true;
  for (int i = 0; i < 5000 && world.core.phase(1) != LinkPhase::flying; ++i) world.step();
}

void fly_by_hand(LinkWorld& world, const std::array<float, 3>& velocity, TimeNs duration) {
  for (const TimeNs end = world.now + duration; world.now < end;) {
    world.fly_plan(velocity).body_frame = true;
    world.pass(100 * ms);
  }
}

TEST(ByHand, ADroneWithoutAnyPoseTakesOffFliesAndLands) {
  LinkWorld world(1, free_by_hand());
  world.mocap = false;
  world.tellos[0].yaw = 1.0;
  take_off_by_hand(world);
  ASSERT_EQ(world.core.phase(1), LinkPhase::flying);
  fly_by_hand(world, {0.5F, 0, 0}, 2 * ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
  // Along its nose, though link never knew where that points.
  EXPECT_NEAR(world.tellos[0].position[0], std::cos(1.0), 0.15);
  EXPECT_NEAR(world.tellos[0].position[1], std::sin(1.0), 0.15);
  world.plan(PlanAction::land);
  world.pass(10 * ns_per_s);
  EXPECT_EQ(world.core.phase(1), LinkPhase::landed);
}

TEST(ByHand, APathWithoutAPoseDoesNotTakeOff) {
  LinkWorld world(1, free_by_hand());
  world.mocap = false;
  world.take_off();
  EXPECT_EQ(world.core.phase(1), LinkPhase::on_ground);
}

TEST(ByHand, WithAPoseForwardIsAlongTheNoseAndTheFenceHolds) {
  LinkSettings settings;
  settings.fence.max_m = {2, 1, 3};
  LinkWorld world(1, free_by_hand(settings));
  world.tellos[0].yaw = 1.5707963;
  take_off_by_hand(world);
  fly_by_hand(world, {0.5F, 0, 0}, 6 * ns_per_s);
  EXPECT_NEAR(world.tellos[0].position[0], 0, 0.05);
  EXPECT_LE(world.tellos[0].position[1], 1.05);
  EXPECT_GT(world.tellos[0].position[1], 0.8);
}

TEST(ByHand, WhenThePoseGoesAwayThePilotFliesOn) {
  LinkWorld world(1, free_by_hand());
  take_off_by_hand(world);
  fly_by_hand(world, {0.3F, 0, 0}, ns_per_s);
  world.mocap = false;
  const double before = world.tellos[0].position[0];
  fly_by_hand(world, {0.3F, 0, 0}, 3 * ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
  EXPECT_NEAR(world.tellos[0].position[0] - before, 0.9, 0.15);
}

TEST(ByHand, APilotEndsTheBrakeOfAPathWhosePoseWasLost) {
  LinkWorld world(1, free_by_hand());
  world.take_off();
  world.fly_plan({0.3F, 0, 0});
  world.pass(200 * ms);
  world.mocap = false;
  world.pass(ns_per_s);
  ASSERT_EQ(world.core.mode(1), FailsafeMode::brake);
  fly_by_hand(world, {0.3F, 0, 0}, 2 * ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
}

TEST(ByHand, WithoutAPoseItClimbsAndSinksByItsOwnHeightInEachFlight) {
  LinkWorld world(1, free_by_hand());
  world.mocap = false;
  for (int flight = 0; flight < 3; ++flight) {
    take_off_by_hand(world);
    ASSERT_EQ(world.core.phase(1), LinkPhase::flying) << flight;
    fly_by_hand(world, {0, 0, 0.5F}, 2 * ns_per_s);
    EXPECT_NEAR(world.tellos[0].position[2], 2, 0.2) << flight;
    fly_by_hand(world, {0, 0, -0.5F}, 2 * ns_per_s);
    EXPECT_NEAR(world.tellos[0].position[2], 1, 0.3) << flight;
    fly_by_hand(world, {0, 0, 0.5F}, 10 * ns_per_s);
    EXPECT_LT(world.tellos[0].position[2], world.settings_.fence.max_m[2] + 0.2) << flight;
    world.plan(PlanAction::land);
    world.pass(12 * ns_per_s);
    ASSERT_EQ(world.core.phase(1), LinkPhase::landed) << flight;
  }
}

// A barometer that sinks takes `h` along, and the pilot would climb through the ceiling: tof sees how far the floor is.
TEST(ByHand, WithoutAPoseTheCeilingHoldsByTofWhereTheBarometerSinks) {
  LinkSettings settings;
  settings.fence.max_m = {20, 20, 2};
  LinkWorld world(1, free_by_hand(settings));
  world.mocap = false;
  take_off_by_hand(world);
  world.tellos[0].height_error_m = -1.5;
  fly_by_hand(world, {0, 0, 0.5F}, 8 * ns_per_s);
  EXPECT_GT(world.tellos[0].position[2], 1.7);
  EXPECT_LT(world.tellos[0].position[2], 2.2);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
}

TEST(ByHand, WhereTheConfigDoesNotAllowItAPilotIsBrakedAsAPathIs) {
  LinkWorld world;
  take_off_by_hand(world);
  ASSERT_EQ(world.core.phase(1), LinkPhase::flying);
  world.mocap = false;
  fly_by_hand(world, {0.3F, 0, 0}, ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::brake);

  LinkWorld blind;
  blind.mocap = false;
  take_off_by_hand(blind);
  EXPECT_EQ(blind.core.phase(1), LinkPhase::on_ground);
}

TEST(ByHand, APathIsNotFreedByATakeOffOrALaterPlanInTheDronesFrame) {
  for (const bool by_takeoff : {true, false}) {
    LinkWorld world(1, free_by_hand());
    world.take_off();
    world.fly_plan({0.3F, 0, 0}, max_setpoints);
    world.pass(100 * ms);
    world.mocap = false;
    if (by_takeoff) {
      world.plan(PlanAction::takeoff).body_frame = true;
    } else {
      world.fly_plan({0, 0, 0}, 1, 3 * ns_per_s).body_frame = true;  // not before the path is over
    }
    world.pass(500 * ms);
    EXPECT_EQ(world.core.mode(1), FailsafeMode::brake) << by_takeoff;
    world.pass(500 * ms);
    const double stopped_m = world.tellos[0].position[0];
    world.pass(ns_per_s);
    EXPECT_NEAR(world.tellos[0].position[0], stopped_m, 0.01) << by_takeoff;
  }
}

}  // namespace
}  // namespace ledgerline::link
