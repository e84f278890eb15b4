#include <gtest/gtest.h>

#include <algorithm>

#include "tests/unit/onboard/link/core/link_world.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

/// Plans in the drone's own frame.
namespace ledgerline::link {
namespace {

void take_off_by_hand(LinkWorld& world) {
  world.pass(ns_per_s);
  world.plan(PlanAction::takeoff).body_frame = true;
  for (int i = 0; i < 5000 && world.core.phase(1) != FlightPhase::flying; ++i) world.step();
}

void fly_by_hand(LinkWorld& world, const std::array<float, 3>& velocity, TimeNs duration) {
  for (const TimeNs end = world.now + duration; world.now < end;) {
    world.fly_plan(velocity).body_frame = true;
    world.pass(100 * ms);
  }
}

TEST(ByHand, ADroneWithoutAnyPoseTakesOffFliesAndLands) {
  LinkWorld world;
  world.mocap = false;
  world.tellos[0].yaw = 1.0;
  take_off_by_hand(world);
  ASSERT_EQ(world.core.phase(1), FlightPhase::flying);
  fly_by_hand(world, {0.5F, 0, 0}, 2 * ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
  // Along its nose, though link never knew where that points.
  EXPECT_NEAR(world.tellos[0].position[0], std::cos(1.0), 0.15);
  EXPECT_NEAR(world.tellos[0].position[1], std::sin(1.0), 0.15);
  world.plan(PlanAction::land);
  world.pass(10 * ns_per_s);
  EXPECT_EQ(world.core.phase(1), FlightPhase::landed);
}

TEST(ByHand, APathWithoutAPoseDoesNotTakeOff) {
  LinkWorld world;
  world.mocap = false;
  world.take_off();
  EXPECT_EQ(world.core.phase(1), FlightPhase::on_ground);
}

TEST(ByHand, WithAPoseForwardIsAlongTheNoseAndTheFenceHolds) {
  LinkSettings settings;
  settings.fence.max_m = {2, 1, 3};
  LinkWorld world(1, settings);
  world.tellos[0].yaw = 1.5707963;
  take_off_by_hand(world);
  fly_by_hand(world, {0.5F, 0, 0}, 6 * ns_per_s);
  EXPECT_NEAR(world.tellos[0].position[0], 0, 0.05);
  EXPECT_LE(world.tellos[0].position[1], 1.05);
  EXPECT_GT(world.tellos[0].position[1], 0.8);
}

TEST(ByHand, WhenThePoseGoesAwayThePilotFliesOn) {
  LinkWorld world;
  take_off_by_hand(world);
  fly_by_hand(world, {0.3F, 0, 0}, ns_per_s);
  world.mocap = false;
  const double before = world.tellos[0].position[0];
  fly_by_hand(world, {0.3F, 0, 0}, 3 * ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
  EXPECT_NEAR(world.tellos[0].position[0] - before, 0.9, 0.15);
}

TEST(ByHand, APilotEndsTheBrakeOfAPathWhosePoseWasLost) {
  LinkWorld world;
  world.take_off();
  world.fly_plan({0.3F, 0, 0});
  world.pass(200 * ms);
  world.mocap = false;
  world.pass(ns_per_s);
  ASSERT_EQ(world.core.mode(1), FailsafeMode::brake);
  fly_by_hand(world, {0.3F, 0, 0}, 2 * ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
}

}  // namespace
}  // namespace ledgerline::link
