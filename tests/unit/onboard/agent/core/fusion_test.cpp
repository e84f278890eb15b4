#include "onboard/agent/core/mocap.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/base/random.hpp"

namespace ledgerline::agent {
namespace {

constexpr TimeNs period = 10 * ns_per_ms;

MocapPose at(TimeNs stamp, double x, double y = 0, double z = 1) {
  return MocapPose{.stamp_ns = stamp, .position_m = {x, y, z}, .yaw_rad = 0.3};
}

/// Flies along x at `speed`; returns the last pose.
Pose fly(Fusion& fusion, double speed, int samples, double noise_m = 0, TimeNs start = period) {
  Random random(7);
  Pose pose;
  for (int i = 0; i < samples; ++i) {
    const TimeNs stamp = start + i * period;
    const auto fused = fusion.add(at(stamp, speed * to_seconds(stamp) + noise_m * random.normal(),
                                     noise_m * random.normal(), 1 + noise_m * random.normal()));
    if (fused) pose = *fused;
  }
  return pose;
}

TEST(Fusion, KeepsTheStampAndTheYawOfTheMeasurement) {
  Fusion fusion({});
  const auto pose = fusion.add(at(1234, 5));
  ASSERT_TRUE(pose);
  EXPECT_EQ(pose->stamp_ns, 1234);
  EXPECT_DOUBLE_EQ(pose->yaw_rad, 0.3);
  EXPECT_DOUBLE_EQ(pose->position_m[0], 5);
  EXPECT_DOUBLE_EQ(pose->velocity_mps[0], 0);
}

TEST(Fusion, FindsTheVelocityOfASteadyFlight) {
  Fusion fusion({});
  const Pose pose = fly(fusion, 1.5, 50);
  EXPECT_NEAR(pose.velocity_mps[0], 1.5, 0.01);
  EXPECT_NEAR(pose.velocity_mps[1], 0, 0.01);
  EXPECT_NEAR(pose.position_m[0], 1.5 * to_seconds(pose.stamp_ns), 0.005);
}

TEST(Fusion, VelocityIsLessNoisyThanDifferencesOfTheMeasurements) {
  Fusion fusion({});
  const double noise_m = 0.005;
  double squares = 0;
  Random random(3);
  for (int i = 1; i <= 1000; ++i) {
    const auto pose = fusion.add(at(i * period, noise_m * random.normal()));
    if (pose && i > 100) squares += pose->velocity_mps[0] * pose->velocity_mps[0];
  }
  const double of_differences = noise_m * std::sqrt(2.0) / to_seconds(period);
  EXPECT_LT(std::sqrt(squares / 900), of_differences / 3);
}

TEST(Fusion, AnOutlierIsRejectedAndTheFlightGoesOn) {
  Fusion fusion({});
  fly(fusion, 1, 50);
  EXPECT_FALSE(fusion.add(at(51 * period, 9)));
  EXPECT_EQ(fusion.counters().outliers, 1U);
  const auto next = fusion.add(at(52 * period, to_seconds(52 * period)));
  ASSERT_TRUE(next);
  EXPECT_NEAR(next->velocity_mps[0], 1, 0.05);
}

TEST(Fusion, OutliersThatStayAreTheTruthAndTheFilterRestarts) {
  FusionSettings settings;
  Fusion fusion(settings);
  fly(fusion, 0, 50);
  for (int i = 1; i < settings.outliers_before_reset; ++i) EXPECT_FALSE(fusion.add(at((50 + i) * period, 3)));
  const auto pose = fusion.add(at((50 + settings.outliers_before_reset) * period, 3));
  ASSERT_TRUE(pose);
  EXPECT_DOUBLE_EQ(pose->position_m[0], 3);
  EXPECT_DOUBLE_EQ(pose->velocity_mps[0], 0);
  EXPECT_EQ(fusion.counters().resets, 1U);
}

TEST(Fusion, WhatIsNotFiniteIsRejectedAndLeavesNoTrace) {
  Fusion fusion({});
  fly(fusion, 1, 50);
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    EXPECT_FALSE(fusion.add(at(51 * period, bad)));
    auto yaw = at(51 * period, to_seconds(51 * period));
    yaw.yaw_rad = bad;
    EXPECT_FALSE(fusion.add(yaw));
  }
  EXPECT_EQ(fusion.counters().not_finite, 4U);
  EXPECT_NEAR(fusion.add(at(51 * period, to_seconds(51 * period)))->velocity_mps[0], 1, 0.05);
}

TEST(Fusion, AMeasurementThatIsNotNewerIsRejected) {
  Fusion fusion({});
  EXPECT_TRUE(fusion.add(at(100, 0)));
  EXPECT_FALSE(fusion.add(at(100, 0)));
  EXPECT_FALSE(fusion.add(at(99, 0)));
  EXPECT_EQ(fusion.counters().not_newer, 2U);
}

TEST(Fusion, InFlightOnePlaceOverAndOverIsNotTrusted) {
  FusionSettings settings;
  Fusion fusion(settings);
  fly(fusion, 1, 50);
  int trusted = 0;
  TimeNs stamp = 51 * period;
  for (int i = 0; i < 100; ++i, stamp += period) trusted += fusion.add(at(stamp, 0.51), true).has_value();
  EXPECT_EQ(trusted, settings.frozen_after_ns / period);
  EXPECT_EQ(fusion.counters().frozen, 100U - static_cast<unsigned>(trusted));
  EXPECT_TRUE(fusion.add(at(stamp, 0.5100001), true)) << "it moves again";
}

TEST(Fusion, EachPoseTwiceIsASystemThatMeasuresMoreSeldom) {
  Fusion fusion({});
  for (int i = 1; i <= 200; ++i) ASSERT_TRUE(fusion.add(at(i * period, 0.01 * (i / 5)), true)) << i;
}

TEST(Fusion, AfterALongGapTheOldVelocityIsForgotten) {
  FusionSettings settings;
  Fusion fusion(settings);
  fly(fusion, 2, 50);
  const auto pose = fusion.add(at(50 * period + settings.max_gap_ns + 1, 7));
  ASSERT_TRUE(pose);
  EXPECT_DOUBLE_EQ(pose->position_m[0], 7);
  EXPECT_DOUBLE_EQ(pose->velocity_mps[0], 0);
}

TEST(Fusion, AShortGapIsBridged) {
  Fusion fusion({});
  fly(fusion, 1, 50);
  const TimeNs stamp = 50 * period + 200 * ns_per_ms;
  const auto pose = fusion.add(at(stamp, to_seconds(stamp)));
  ASSERT_TRUE(pose);
  EXPECT_NEAR(pose->velocity_mps[0], 1, 0.05);
}

}  // namespace
}  // namespace ledgerline::agent
