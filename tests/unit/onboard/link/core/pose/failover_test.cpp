#include "onboard/link/core/pose/failover.hpp"

#include <gtest/gtest.h>

#include "tests/unit/onboard/link/core/link_world.hpp"

/// Motion capture that goes away and comes back, and the drone's own senses meanwhile: the place never jumps.
namespace ledgerline::link {
namespace {

constexpr TimeNs ms = ns_per_ms;

Pose at(TimeNs stamp_ns, double x, double speed_mps = 0, double yaw_rad = 0) {
  Pose pose;
  pose.stamp_ns = stamp_ns;
  pose.position_m = {x, 0, 1};
  pose.velocity_mps = {speed_mps, 0, 0};
  pose.yaw_rad = yaw_rad;
  pose.variance = {0.01F, 0.01F, 0.01F, 0.01F};
  return pose;
}

TEST(Failover, WhatLiesBetweenTheSourcesIsLetInSlowlyAndToldAsVariance) {
  Failover failover(150 * ms, 0.2);
  EXPECT_DOUBLE_EQ(failover.by_mocap(at(1000 * ms, 1.0, 0.5), true).position_m[0], 1.0);
  // 0.2 s later it has flown on by 0.1 m; its own senses are 0.4 m and 0.3 rad off.
  Pose told = failover.by_own_senses(at(1200 * ms, 1.5, 0.5, 0.3), true);
  EXPECT_NEAR(told.position_m[0], 1.1, 1e-9);
  EXPECT_NEAR(told.yaw_rad, 0, 1e-9);
  EXPECT_NEAR(told.variance[0], 0.01 + 0.16, 1e-6);
  EXPECT_NEAR(told.variance[3], 0.01 + 0.09, 1e-6);
  told = failover.by_own_senses(at(2200 * ms, 2.0, 0.5, 0.3), true);
  EXPECT_NEAR(told.position_m[0], 1.8, 1e-9) << "0.2 m of the 0.4";
  told = failover.by_own_senses(at(4200 * ms, 3.0, 0.5, 0.3), true);
  EXPECT_NEAR(told.position_m[0], 3.0, 1e-9);
  EXPECT_NEAR(told.yaw_rad, 0.3, 1e-9);
  EXPECT_NEAR(told.variance[0], 0.01, 1e-6);
  // And back.
  told = failover.by_mocap(at(4300 * ms, 2.8, 0.5), true);
  EXPECT_NEAR(told.position_m[0], 3.05, 1e-9);
}

TEST(Failover, OnTheGroundTheSourceCountsAtOnce) {
  Failover failover(150 * ms, 0.2);
  failover.by_own_senses(at(1000 * ms, 1.0), false);
  EXPECT_DOUBLE_EQ(failover.by_mocap(at(1100 * ms, 5.0), false).position_m[0], 5.0);
}

TEST(Failover, ItIsMissingOnlyAfterItWasThere) {
  Failover failover(150 * ms, 0.2);
  EXPECT_FALSE(failover.missing(10'000 * ms));
  failover.heard(10'000 * ms);
  EXPECT_FALSE(failover.missing(10'150 * ms));
  EXPECT_TRUE(failover.missing(10'151 * ms));
}

LinkSettings joined() {
  LinkSettings settings;
  DroneSettings drone;
  drone.name = "tello1";
  drone.number = 1;
  drone.source = PoseSource::mocap_then_tello;
  settings.drones.push_back(drone);
  return settings;
}

void fly(LinkWorld& world, TimeNs duration) {
  for (const TimeNs end = world.now + duration; world.now < end;) {
    world.fly_plan({0.3F, 0, 0});
    world.pass(100 * ms);
  }
}

TEST(Failover, ADroneFliesOnByItsOwnSensesAndNeverJumps) {
  LinkWorld world(1, joined());
  world.tellos[0].position[0] = 4;  // where nobody said that it starts
  world.tellos[0].yaw = 1.5707963;
  world.tellos[0].tells_velocity = true;
  world.take_off();
  ASSERT_EQ(world.core.phase(1), FlightPhase::flying);
  fly(world, 2 * ns_per_s);
  world.mocap = false;
  double before = world.core.pose(1).position_m[0];
  for (int i = 0; i < 30; ++i) {
    fly(world, 100 * ms);
    const Pose pose = world.core.pose(1);
    EXPECT_LT(std::abs(pose.position_m[0] - before), 0.12) << "0.3 m/s, a text or two";
    before = pose.position_m[0];
    EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
  }
  EXPECT_GT(world.core.pose(1).stamp_ns, world.now - 150 * ms);
  EXPECT_NEAR(world.core.pose(1).position_m[0], world.tellos[0].position[0], 0.1);
  EXPECT_GT(world.core.pose(1).variance[0], 1e-4F);
  world.mocap = true;
  fly(world, 3 * ns_per_s);
  EXPECT_NEAR(world.core.pose(1).position_m[0], world.tellos[0].position[0], 0.02);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
}

TEST(Failover, WithoutItTheSameDroneBrakes) {
  LinkSettings settings = joined();
  settings.drones[0].source = PoseSource::mocap;
  LinkWorld world(1, settings);
  world.take_off();
  fly(world, 2 * ns_per_s);
  world.mocap = false;
  fly(world, ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::brake);
}

TEST(Failover, BlindAndWithoutMotionCaptureItBrakes) {
  LinkWorld world(1, joined());
  world.tellos[0].tells_velocity = true;
  world.take_off();
  fly(world, 2 * ns_per_s);
  world.mocap = false;
  fly(world, ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
  world.tellos[0].states = false;
  fly(world, ns_per_s);
  EXPECT_NE(world.core.mode(1), FailsafeMode::none);
}

}  // namespace
}  // namespace ledgerline::link
