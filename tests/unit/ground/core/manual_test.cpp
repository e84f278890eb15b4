#include "ground/core/manual.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace ledgerline::ground {
namespace {

constexpr TimeNs timeout_ns = 300 * ns_per_ms;
constexpr TimeNs drone_ns = 5'000 * ns_per_s;  // the drone's clock, which has nothing to do with the ground's
constexpr TimeNs ground_ns = 70 * ns_per_s;

StateSample facing(double yaw_rad) {
  StateSample state;
  state.stamp_ns = state.pose_stamp_ns = drone_ns;
  state.yaw_rad = yaw_rad;
  return state;
}

std::vector<Setpoint> plan_of(ManualController& manual, TimeNs now_ns, const StateSample& state, TimeNs first_ns) {
  manual.observe(state, 0);
  return manual.plan(static_cast<std::uint64_t>(now_ns), now_ns, first_ns);
}

bool is_zero(const Setpoint& s) { return s.velocity_mps == std::array<float, 3>{} && s.yaw_rate_radps == 0; }

/// What a plan wants at a time behind its first setpoint.
Setpoint at(const std::vector<Setpoint>& plan, TimeNs after_ns) {
  Setpoint found = plan.front();
  for (const Setpoint& s : plan) {
    if (s.at_ns <= plan.front().at_ns + after_ns) found = s;
  }
  return found;
}

TEST(Manual, WithoutAWishEveryPlanIsZero) {
  ManualController manual({}, timeout_ns);
  for (const Setpoint& s : plan_of(manual, ground_ns, facing(1), drone_ns)) EXPECT_TRUE(is_zero(s));
}

TEST(Manual, AWishIsFlownUntilItsTimeIsOverAndNotAMomentLonger) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.take(ground_ns, Twist{{0.4, 0, 0.2}, {0, 0, 0.5}}));
  for (const TimeNs later_ns : {0, 70, 200, 299}) {
    const TimeNs left_ns = timeout_ns - later_ns * ns_per_ms;
    const auto plan = plan_of(manual, ground_ns + later_ns * ns_per_ms, facing(0), drone_ns + later_ns * ns_per_ms);
    EXPECT_FALSE(is_zero(at(plan, left_ns - 1))) << later_ns;
    EXPECT_TRUE(is_zero(at(plan, left_ns))) << later_ns;
    EXPECT_TRUE(is_zero(plan.back())) << later_ns;
  }
  for (const Setpoint& s : plan_of(manual, ground_ns + timeout_ns, facing(0), drone_ns + timeout_ns))
    EXPECT_TRUE(is_zero(s));
}

TEST(Manual, AWishThatIsOldWhenItIsLookedAtIsNotFlownLongerForIt) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.take(ground_ns - 250 * ns_per_ms, Twist{{0.4, 0, 0}, {}}));
  const auto plan = plan_of(manual, ground_ns, facing(0), drone_ns);
  EXPECT_FALSE(is_zero(at(plan, 0)));
  EXPECT_TRUE(is_zero(at(plan, 50 * ns_per_ms)));
}

TEST(Manual, ReleasedIsAsIfNothingHadBeenWished) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.take(ground_ns, Twist{{0.4, 0, 0}, {}}));
  manual.release();
  for (const Setpoint& s : plan_of(manual, ground_ns, facing(0), drone_ns)) EXPECT_TRUE(is_zero(s));
}

TEST(Manual, EveryTimeOutLeavesAPlanItsZero) {
  ManualController manual({}, 60 * ns_per_s);
  ASSERT_TRUE(manual.take(ground_ns, Twist{{0.4, 0, 0}, {}}));
  const auto plan = plan_of(manual, ground_ns, facing(0), drone_ns);
  EXPECT_TRUE(is_zero(plan.back()));
  EXPECT_LE(plan.size(), max_setpoints);
  for (std::size_t i = 1; i < plan.size(); ++i) EXPECT_LT(plan[i - 1].at_ns, plan[i].at_ns);
}

TEST(Manual, ForwardIsWhereTheNoseIsAndLeftIsLeftOfIt) {
  for (const double yaw : {0.0, 0.5, std::numbers::pi / 2, -2.0, 3.0}) {
    ManualController forward({}, timeout_ns), left({}, timeout_ns);
    ASSERT_TRUE(forward.take(ground_ns, Twist{{0.3, 0, 0}, {}}));
    ASSERT_TRUE(left.take(ground_ns, Twist{{0, 0.3, 0}, {}}));
    const Setpoint ahead = plan_of(forward, ground_ns, facing(yaw), drone_ns).front();
    const Setpoint aside = plan_of(left, ground_ns, facing(yaw), drone_ns).front();
    EXPECT_NEAR(ahead.velocity_mps[0], 0.3 * std::cos(yaw), 1e-6);
    EXPECT_NEAR(ahead.velocity_mps[1], 0.3 * std::sin(yaw), 1e-6);
    EXPECT_NEAR(aside.velocity_mps[0], -0.3 * std::sin(yaw), 1e-6);
    EXPECT_NEAR(aside.velocity_mps[1], 0.3 * std::cos(yaw), 1e-6);
  }
}

TEST(Manual, WhileItTurnsItsForwardTurnsWithIt) {
  ControllerConfig config;
  ManualController manual(config, timeout_ns);
  ASSERT_TRUE(manual.take(ground_ns, Twist{{0.3, 0, 0}, {0, 0, 0.6}}));
  const auto first = plan_of(manual, ground_ns, facing(0), drone_ns);
  const Setpoint late = at(first, 250 * ns_per_ms);
  EXPECT_NEAR(std::atan2(late.velocity_mps[1], late.velocity_mps[0]), 0.25 * 0.6, 1e-6);
  // The next plan begins where the first one will have turned the drone, though the state is from before it.
  ASSERT_TRUE(manual.take(ground_ns + 200 * ns_per_ms, Twist{{0.3, 0, 0}, {}}));
  const auto next = plan_of(manual, ground_ns + 200 * ns_per_ms, facing(0), drone_ns + 200 * ns_per_ms);
  EXPECT_NEAR(std::atan2(next.front().velocity_mps[1], next.front().velocity_mps[0]), 0.2 * 0.6, 1e-6);
}

TEST(Manual, APlanThatIsWithdrawnTurnsNothing) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.take(ground_ns, Twist{{0.3, 0, 0}, {0, 0, 0.6}}));
  (void)plan_of(manual, ground_ns, facing(0), drone_ns);
  manual.withdraw(static_cast<std::uint64_t>(ground_ns));
  const auto next = manual.plan(1, ground_ns + 200 * ns_per_ms, drone_ns + 200 * ns_per_ms);
  EXPECT_NEAR(next.front().velocity_mps[1], 0, 1e-6);
}

TEST(Manual, FasterThanAllowedIsAsFastAsAllowedInTheSameDirection) {
  ControllerConfig config;
  config.speed_mps = 0.5;
  ManualController manual(config, timeout_ns);
  ASSERT_TRUE(manual.take(ground_ns, Twist{{3, -4, 9}, {0, 0, -50}}));
  const Setpoint s = plan_of(manual, ground_ns, facing(0), drone_ns).front();
  EXPECT_NEAR(s.velocity_mps[0], 0.3, 1e-6);
  EXPECT_NEAR(s.velocity_mps[1], -0.4, 1e-6);
  EXPECT_NEAR(s.velocity_mps[2], config.max_vertical_mps, 1e-6);
  EXPECT_NEAR(s.yaw_rate_radps, -config.max_yaw_rate_radps, 1e-6);
}

TEST(Manual, NumbersThatNoDroneCanFlyAreRefusedAndTheWishBeforeThemRunsOut) {
  ManualController manual({}, timeout_ns);
  ASSERT_TRUE(manual.take(ground_ns, Twist{{0.4, 0, 0}, {}}));
  constexpr double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf, 1e300, -101.0}) {
    for (std::size_t i = 0; i < 3; ++i) {
      Twist linear, angular;
      linear.linear_mps[i] = bad;
      angular.angular_radps[i] = bad;
      EXPECT_FALSE(manual.take(ground_ns + 200 * ns_per_ms, linear)) << bad << " " << i;
      EXPECT_FALSE(manual.take(ground_ns + 200 * ns_per_ms, angular)) << bad << " " << i;
    }
  }
  const auto plan = plan_of(manual, ground_ns + 200 * ns_per_ms, facing(0), drone_ns);
  EXPECT_FLOAT_EQ(at(plan, 99 * ns_per_ms).velocity_mps[0], 0.4F);
  EXPECT_TRUE(is_zero(at(plan, 100 * ns_per_ms)));
}

}  // namespace
}  // namespace ledgerline::ground
