#include "onboard/link/core/pose/drone_position.hpp"

#include <gtest/gtest.h>

#include "tests/unit/onboard/link/core/link_world.hpp"

/// Motion capture that is lost and comes back, and onboard odometry meanwhile: the position never jumps.
namespace ledgerline::link {
namespace {

constexpr TimeNs ms = ns_per_ms;
using Source = Failover::Source;

Pose at(TimeNs stamp_ns, double x, double speed_mps = 0, double yaw_rad = 0) {
  Pose pose;
  pose.stamp_ns = stamp_ns;
  pose.position_m = {x, 0, 1};
  pose.velocity_mps = {speed_mps, 0, 0};
  pose.yaw_rad = yaw_rad;
  pose.variance = {0.01F, 0.01F, 0.01F, 0.01F};
  return pose;
}

TEST(Failover, WhatLiesBetweenTheSourcesIsLetInSlowlyAndReportedAsVariance) {
  Failover failover(150 * ms, 0.2);
  EXPECT_DOUBLE_EQ(failover.to_publish(Source::mocap, at(1000 * ms, 1.0, 0.5), true).position_m[0], 1.0);
  // 0.2 s later it has flown on by 0.1 m; onboard odometry is 0.4 m and 0.3 rad off.
  Pose sent = failover.to_publish(Source::own, at(1200 * ms, 1.5, 0.5, 0.3), true);
  EXPECT_NEAR(sent.position_m[0], 1.1, 1e-9);
  EXPECT_NEAR(sent.yaw_rad, 0, 1e-9);
  EXPECT_NEAR(sent.variance[0], 0.01 + 0.16, 1e-6);
  EXPECT_NEAR(sent.variance[3], 0.01 + 0.09, 1e-6);
  for (int i = 1; i <= 10; ++i) {
    sent = failover.to_publish(Source::own, at((1200 + 100 * i) * ms, 1.5 + 0.05 * i, 0.5, 0.3), true);
    EXPECT_NEAR(sent.position_m[0], 1.1 + 0.05 * i + 0.02 * i, 1e-9) << "0.2 m/s of the 0.4 m";
  }
  for (int i = 11; i <= 30; ++i)
    sent = failover.to_publish(Source::own, at((1200 + 100 * i) * ms, 1.5 + 0.05 * i, 0.5, 0.3), true);
  EXPECT_NEAR(sent.position_m[0], 3.0, 1e-9);
  EXPECT_NEAR(sent.yaw_rad, 0.3, 1e-9);
  EXPECT_NEAR(sent.variance[0], 0.01, 1e-6);
  // And back.
  sent = failover.to_publish(Source::mocap, at(4300 * ms, 2.8, 0.5), true);
  EXPECT_NEAR(sent.position_m[0], 3.05, 1e-9);
  EXPECT_EQ(failover.source(), Source::mocap);
}

TEST(Failover, BehindAGapWithoutEitherTheNewPlaceCountsAtOnce) {
  Failover failover(100 * ms, 0.2);
  failover.to_publish(Source::own, at(1000 * ms, 1.0, 1.0), true);
  const Pose sent = failover.to_publish(Source::mocap, at(4000 * ms, 1.3), true);
  EXPECT_DOUBLE_EQ(sent.position_m[0], 1.3) << "it has braked meanwhile, and nobody flies by the place of before";
  EXPECT_NEAR(sent.variance[0], 0.01, 1e-6);
}

TEST(Failover, OnTheGroundTheSourceCountsAtOnce) {
  Failover failover(150 * ms, 0.2);
  failover.to_publish(Source::own, at(1000 * ms, 1.0), false);
  EXPECT_DOUBLE_EQ(failover.to_publish(Source::mocap, at(1100 * ms, 5.0), false).position_m[0], 5.0);
}

TEST(Failover, ItIsMissingOnlyAfterItWasThere) {
  Failover failover(150 * ms, 0.2);
  EXPECT_FALSE(failover.is_missing(10'000 * ms));
  failover.on_mocap(10'000 * ms);
  EXPECT_FALSE(failover.is_missing(10'150 * ms));
  EXPECT_TRUE(failover.is_missing(10'151 * ms));
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

TEST(Failover, ADroneFliesOnByOnboardOdometryAndNeverJumps) {
  LinkWorld world(1, joined());
  world.tellos[0].position[0] = 4;  // where nobody said that it starts
  world.tellos[0].yaw = 1.5707963;
  world.tellos[0].tells_velocity = true;
  world.take_off();
  ASSERT_EQ(world.core.phase(1), LinkPhase::flying);
  fly(world, 2 * ns_per_s);
  world.mocap = false;
  double before = world.states.back().position_m[0];
  for (int i = 0; i < 60; ++i) {
    if (i == 30) world.mocap = true;
    fly(world, 100 * ms);
    const double sent = world.states.back().position_m[0];
    EXPECT_LT(std::abs(sent - before), 0.12) << "0.3 m/s, a text or two";
    before = sent;
    EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
    if (i != 29) continue;
    EXPECT_GT(world.core.pose(1).stamp_ns, world.now - 150 * ms);
    EXPECT_NEAR(world.core.pose(1).position_m[0], world.tellos[0].position[0], 0.1);
    EXPECT_GT(world.core.pose(1).variance[0], 1e-4F);
  }
  EXPECT_NEAR(world.states.back().position_m[0], world.tellos[0].position[0], 0.03);
}

TEST(Failover, MotionCaptureThatIsSlowIsNotMissing) {
  LinkWorld world(1, joined());
  world.tellos[0].tells_velocity = true;
  world.mocap_late_ns = 200 * ms;
  world.take_off();
  ASSERT_EQ(world.core.phase(1), LinkPhase::flying);
  fly(world, 3 * ns_per_s);
  EXPECT_EQ(world.core.mode(1), FailsafeMode::none);
  EXPECT_EQ(world.core.pose(1).variance[0], 0) << "motion capture's, not onboard odometry's";
}

TEST(Failover, WhoStandsWaitsForMotionCapture) {
  LinkWorld world(1, joined());
  world.tellos[0].tells_velocity = true;
  world.pass(5 * ns_per_s);
  world.mocap = false;
  world.pass(ns_per_s);
  world.tellos[0].position[0] = 3;  // somebody carries it, and it tells no velocity
  world.plan(PlanAction::takeoff);
  world.pass(3 * ns_per_s);
  EXPECT_EQ(world.core.phase(1), LinkPhase::on_ground);
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
