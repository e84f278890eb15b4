#include "onboard/link/core/playout/playout.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "tests/unit/onboard/link/core/playout/plans.hpp"

namespace ledgerline::link {
namespace {

class PlanAdmissionTest : public ::testing::Test {
 protected:
  DropReason admit(TimeNs now, const Plan& plan) {
    const DropReason reason = admission.admit(now, plan);
    if (reason == DropReason::none) ++admitted;
    return reason;
  }
  /// What was admitted is pending: the one that acts on it reports how it ended.
  void expect_sums() {
    const PlanCounters& c = admission.counters();
    EXPECT_EQ(c.received, admitted + c.dropped);
    std::uint32_t by_reason = 0;
    for (const std::uint32_t n : c.dropped_by) by_reason += n;
    EXPECT_EQ(c.dropped, by_reason);
  }

  PlayoutSettings settings;
  PlanAdmission admission{settings};
  std::uint32_t admitted = 0;
  TimeNs t = 100 * ns_per_s;
};

TEST_F(PlanAdmissionTest, ReplayedAndReorderedPlansAreDropped) {
  admit(t, plan_of(5, t, 4, 1, t));
  EXPECT_EQ(admit(t, plan_of(5, t, 4, 1, t)), DropReason::out_of_order);
  EXPECT_EQ(admit(t, plan_of(4, t, 4, 1, t)), DropReason::out_of_order);
  Plan next_lease = plan_of(1, t, 4, 1, t);
  next_lease.epoch = 2;
  EXPECT_EQ(admit(t, next_lease), DropReason::none);
  EXPECT_EQ(admit(t, plan_of(9, t, 4, 1, t)), DropReason::out_of_order);  // of the old lease
  expect_sums();
}

TEST_F(PlanAdmissionTest, APlanMadeFromTooOldAStateIsDropped) {
  EXPECT_EQ(admit(t, plan_of(1, t, 4, 1, t - settings.max_age_ns - ms)), DropReason::too_old);
  EXPECT_EQ(admit(t, plan_of(2, t, 4, 1, t - settings.max_age_ns + ms)), DropReason::none);
  expect_sums();
}

TEST_F(PlanAdmissionTest, ALandingIsNeverTooOld) {
  Plan plan = plan_of(1, t, 0, 0, t - 100 * ns_per_s);
  plan.action = PlanAction::land;
  EXPECT_EQ(admission.admit(t, plan), DropReason::none);
}

TEST_F(PlanAdmissionTest, AStopIsInNobodysSequence) {
  admit(t, plan_of(5, t, 4, 1, t));
  Plan stop = plan_of(0, t, 0, 0, 0);
  stop.action = PlanAction::stop;
  stop.epoch = 0;
  EXPECT_EQ(admission.admit(t, stop), DropReason::none);
  EXPECT_EQ(admit(t, plan_of(6, t, 4, 1, t)), DropReason::none);
}

TEST_F(PlanAdmissionTest, BadNumbersAreDroppedNotFlown) {
  std::uint64_t sequence = 0;
  const auto refused = [&](auto spoil) {
    Plan plan = plan_of(++sequence, t, 4, 1, t);
    spoil(plan);
    return admit(t, plan) == DropReason::bad_value;
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinite = std::numeric_limits<float>::infinity();
  EXPECT_TRUE(refused([](Plan& p) { p.count = 0; }));
  EXPECT_TRUE(refused([](Plan& p) { p.count = max_setpoints + 1; }));
  EXPECT_TRUE(refused([](Plan& p) { p.count = 0xFFFFFFFF; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.setpoints[2].velocity_mps[1] = nan; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.setpoints[0].velocity_mps[2] = -infinite; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.setpoints[3].yaw_rate_radps = nan; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.setpoints[0].velocity_mps[0] = 1e6F; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.setpoints[1].reference.position_m[0] = nan; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.setpoints[1].reference.velocity_mps[2] = infinite; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.setpoints[1].reference.acceleration_mps2[1] = -1e6F; }));
  EXPECT_TRUE(refused([](Plan& p) { p.response.lag_s = 0; }));
  EXPECT_TRUE(refused([](Plan& p) { p.setpoints[2].at_ns = p.setpoints[1].at_ns; }));
  EXPECT_TRUE(refused([](Plan& p) { p.setpoints[0].at_ns = -1; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.setpoints[3].at_ns = t + 100 * ns_per_s; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.state_stamp_ns = t + ms; }));
  expect_sums();
}

TEST_F(PlanAdmissionTest, EveryPlanThatEndsUnflownIsNamedWithItsReasonOnce) {
  Plan plan = plan_of(1, t, 2, 1, t);
  admit(t, plan);
  admission.record_end(plan, DropReason::none);
  admit(t, plan);
  ASSERT_EQ(admission.ends().size(), 2U);
  EXPECT_EQ(admission.ends()[0].reason, DropReason::none);
  EXPECT_EQ(admission.ends()[1].reason, DropReason::out_of_order);
  EXPECT_EQ(admission.ends()[1].sequence, 1U);
  admission.clear_ends();
  EXPECT_TRUE(admission.ends().empty());
  expect_sums();
}

}  // namespace
}  // namespace ledgerline::link
