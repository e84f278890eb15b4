#include "onboard/link/core/playout/setpoint_path.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace ledgerline::link {
namespace {

class LimiterTest : public ::testing::Test {
 protected:
  void SetUp() override { limiter.reset(now); }
  Velocity run(TimeNs duration, const Velocity& desired, bool braking = false) {
    for (const TimeNs end = now + duration; now < end;) {
      now += ns_per_ms;
      limiter.step(now, desired, braking);
    }
    return limiter.output();
  }
  PlayoutSettings settings;
  Limiter limiter{settings};
  TimeNs now = ns_per_s;
};

TEST_F(LimiterTest, AStepInTheSetpointBecomesARamp) {
  const Velocity half = run(100 * ns_per_ms, {{1, 0, 0}, 0});
  EXPECT_NEAR(half.mps[0], 0.1 * settings.max_acceleration_mps2, 0.01);
  EXPECT_FLOAT_EQ(run(ns_per_s, {{1, 0, 0}, 0}).mps[0], 1);
}

TEST_F(LimiterTest, TheRampEndsInExactlyZero) {
  run(ns_per_s, {{1, -1, 0.5F}, 1});
  const Velocity end = run(ns_per_s, {});
  EXPECT_EQ(end.mps, (std::array<float, 3>{0, 0, 0}));
  EXPECT_EQ(end.yaw_radps, 0);
}

TEST_F(LimiterTest, TheHorizontalSpeedIsLimitedWithItsDirectionKept) {
  const Velocity fast = run(10 * ns_per_s, {{30, 40, 50}, 60});
  EXPECT_NEAR(std::hypot(fast.mps[0], fast.mps[1]), settings.max_speed_mps, 1e-4);
  EXPECT_NEAR(fast.mps[1] / fast.mps[0], 4.0 / 3, 1e-4);
  EXPECT_FLOAT_EQ(fast.mps[2], settings.max_vertical_mps);
  EXPECT_FLOAT_EQ(fast.yaw_radps, settings.max_yaw_rate_radps);
}

TEST_F(LimiterTest, ALongGapBetweenStepsAllowsNoBigJump) {
  now += 10 * ns_per_s;
  EXPECT_LE(limiter.step(now, {{2, 0, 0}, 0}, false).mps[0], 0.05F * settings.max_acceleration_mps2 + 1e-5F);
}

TEST_F(LimiterTest, ABrakeIsTwiceAsFast) {
  run(ns_per_s, {{1, 0, 0}, 0});
  EXPECT_NEAR(run(100 * ns_per_ms, {}, true).mps[0], 1 - 0.2 * settings.max_acceleration_mps2, 0.01);
}

}  // namespace
}  // namespace ledgerline::link
