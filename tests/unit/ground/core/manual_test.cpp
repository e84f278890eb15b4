#include "ground/core/manual.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace ledgerline::ground {
namespace {

constexpr TimeNs timeout_ns = 300 * ns_per_ms;
constexpr TimeNs drone_ns = 5'000 * ns_per_s;  // the drone's clock, which has nothing to do with the ground's
constexpr TimeNs ground_ns = 70 * ns_per_s;

bool is_zero(const Setpoint& s) { return s.velocity_mps == std::array<float, 3>{} && s.yaw_rate_radps == 0; }

/// What a plan wants at a time behind its first setpoint.
Setpoint at(const std::vector<Setpoint>& plan, TimeNs after_ns) {
  Setpoint found = plan.front();
  for (const Setpoint& s : plan) {
    if (s.at_ns <= plan.front().at_ns + after_ns) found = s;
  }
  return found;
}

TEST(Manual, WithoutACommandEveryPlanIsZero) {
  ManualController manual({}, timeout_ns);
  for (const Setpoint& s : manual.plan(ground_ns, drone_ns)) EXPECT_TRUE(is_zero(s));
}

TEST(Manual, ACommandIsFlownUntilItsTimeoutAndNotLonger) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.set_velocity(ground_ns, Twist{{0.4, 0, 0.2}, {0, 0, 0.5}}));
  for (const TimeNs later_ns : {0, 70, 200, 299}) {
    const TimeNs left_ns = timeout_ns - later_ns * ns_per_ms;
    const auto plan = manual.plan(ground_ns + later_ns * ns_per_ms, drone_ns + later_ns * ns_per_ms);
    EXPECT_FALSE(is_zero(at(plan, left_ns - 1))) << later_ns;
    EXPECT_TRUE(is_zero(at(plan, left_ns))) << later_ns;
    EXPECT_TRUE(is_zero(plan.back())) << later_ns;
  }
  for (const Setpoint& s : manual.plan(ground_ns + timeout_ns, drone_ns + timeout_ns)) EXPECT_TRUE(is_zero(s));
}

TEST(Manual, ACommandThatIsOldWhenItIsReadIsNotFlownLonger) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.set_velocity(ground_ns - 250 * ns_per_ms, Twist{{0.4, 0, 0}, {}}));
  const auto plan = manual.plan(ground_ns, drone_ns);
  EXPECT_FALSE(is_zero(at(plan, 0)));
  EXPECT_TRUE(is_zero(at(plan, 50 * ns_per_ms)));
}

TEST(Manual, AReleaseIsAsIfNothingHadBeenCommanded) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.set_velocity(ground_ns, Twist{{0.4, 0, 0}, {}}));
  manual.release();
  for (const Setpoint& s : manual.plan(ground_ns, drone_ns)) EXPECT_TRUE(is_zero(s));
}

TEST(Manual, EveryTimeOutLeavesAPlanItsZero) {
  ManualController manual({}, 60 * ns_per_s);
  ASSERT_TRUE(manual.set_velocity(ground_ns, Twist{{0.4, 0, 0}, {}}));
  const auto plan = manual.plan(ground_ns, drone_ns);
  EXPECT_TRUE(is_zero(plan.back()));
  EXPECT_LE(plan.size(), max_setpoints);
  for (std::size_t i = 1; i < plan.size(); ++i) EXPECT_LT(plan[i - 1].at_ns, plan[i].at_ns);
}

TEST(Manual, ACommandStaysInTheBodyFrame) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.set_velocity(ground_ns, Twist{{0.3, 0.1, 0}, {0, 0, 0.6}}));
  const auto plan = manual.plan(ground_ns, drone_ns);
  for (const TimeNs after_ns : {0, 250}) {
    const Setpoint s = at(plan, after_ns * ns_per_ms);
    EXPECT_FLOAT_EQ(s.velocity_mps[0], 0.3F);
    EXPECT_FLOAT_EQ(s.velocity_mps[1], 0.1F);
    EXPECT_FLOAT_EQ(s.yaw_rate_radps, 0.6F);
  }
}

TEST(Manual, FasterThanAllowedIsAsFastAsAllowedInTheSameDirection) {
  ControllerConfig config;
  config.speed_mps = 0.5;
  ManualController manual(config, timeout_ns);
  ASSERT_TRUE(manual.set_velocity(ground_ns, Twist{{3, -4, 9}, {0, 0, -50}}));
  const Setpoint s = manual.plan(ground_ns, drone_ns).front();
  EXPECT_NEAR(s.velocity_mps[0], 0.3, 1e-6);
  EXPECT_NEAR(s.velocity_mps[1], -0.4, 1e-6);
  EXPECT_NEAR(s.velocity_mps[2], config.max_vertical_mps, 1e-6);
  EXPECT_NEAR(s.yaw_rate_radps, -config.max_yaw_rate_radps, 1e-6);
}

TEST(Manual, InvalidNumbersAreRefusedAndTheCommandBeforeThemTimesOut) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.set_velocity(ground_ns, Twist{{0.4, 0, 0}, {}}));
  constexpr double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf, 1e300, -101.0}) {
    for (std::size_t i = 0; i < 3; ++i) {
      Twist linear, angular;
      linear.linear_mps[i] = bad;
      angular.angular_radps[i] = bad;
      EXPECT_FALSE(manual.set_velocity(ground_ns + 200 * ns_per_ms, linear)) << bad << " " << i;
      EXPECT_FALSE(manual.set_velocity(ground_ns + 200 * ns_per_ms, angular)) << bad << " " << i;
    }
  }
  const auto plan = manual.plan(ground_ns + 200 * ns_per_ms, drone_ns);
  EXPECT_FLOAT_EQ(at(plan, 99 * ns_per_ms).velocity_mps[0], 0.4F);
  EXPECT_TRUE(is_zero(at(plan, 100 * ns_per_ms)));
}

}  // namespace
}  // namespace ledgerline::ground
