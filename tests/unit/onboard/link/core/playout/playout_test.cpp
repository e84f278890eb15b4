#include "onboard/link/core/playout/playout.hpp"

#include <gtest/gtest.h>

#include "tests/unit/onboard/link/core/playout/plans.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

class PlayoutTest : public ::testing::Test {
 protected:
  DropReason give(TimeNs now, const Plan& plan) {
    const DropReason reason = admission.admit(now, plan);
    if (reason == DropReason::none) playout.add(now, plan);
    return reason;
  }
  /// Flies the setpoint at `now`, as LinkCore would.
  Playout::CurrentSetpoint fly(TimeNs now) {
    const Playout::CurrentSetpoint setpoint = playout.setpoint(now);
    if (setpoint.valid) playout.mark_sent();
    return setpoint;
  }
  void expect_sums() {
    playout.clear(DropReason::superseded);
    const PlanCounters& c = admission.counters();
    EXPECT_EQ(c.received, c.applied + c.late + c.dropped);
    std::uint32_t by_reason = 0;
    for (const std::uint32_t n : c.dropped_by) by_reason += n;
    EXPECT_EQ(c.dropped, by_reason);
  }

  PlayoutSettings settings;
  PlanAdmission admission{settings};
  Playout playout{settings, admission};
  TimeNs t = 100 * ns_per_s;
};

TEST_F(PlayoutTest, EachSetpointIsFlownAtItsTimeAndNotBefore) {
  Plan plan = plan_of(1, t + 20 * ms, 3, 0, t);
  for (std::uint32_t i = 0; i < 3; ++i) plan.setpoints[i].velocity_mps[0] = static_cast<float>(i + 1);
  EXPECT_EQ(give(t, plan), DropReason::none);
  EXPECT_FALSE(fly(t).valid);
  EXPECT_FALSE(fly(t + 19 * ms).valid);
  EXPECT_EQ(fly(t + 20 * ms).velocity.mps[0], 1);
  EXPECT_EQ(fly(t + 69 * ms).velocity.mps[0], 1);
  EXPECT_EQ(fly(t + 70 * ms).velocity.mps[0], 2);
  EXPECT_EQ(fly(t + 125 * ms).velocity.mps[0], 3);
  EXPECT_FALSE(fly(t + 170 * ms).valid);  // the last one holds as long as the one before it did
  expect_sums();
  EXPECT_EQ(admission.counters().applied, 1U);
}

TEST_F(PlayoutTest, AReferenceMovesOnFromItsSetpointsMoment) {
  Plan plan = plan_of(1, t, 2, 1, t);
  plan.setpoints[1].has_reference = true;
  plan.setpoints[1].reference = {{2, 0, 1}, {1, 0, 0}, {0, 2, 0}};
  give(t, plan);
  EXPECT_FALSE(fly(t).has_reference);
  const auto setpoint = fly(t + 70 * ms);
  ASSERT_TRUE(setpoint.has_reference);
  EXPECT_FLOAT_EQ(setpoint.reference.position_m[0], 2.02F);
  EXPECT_FLOAT_EQ(setpoint.reference.position_m[1], 0.0004F);
  EXPECT_FLOAT_EQ(setpoint.reference.velocity_mps[1], 0.04F);
}

TEST_F(PlayoutTest, APlanInHandFillsTheGapUntilItsSuccessorIsDue) {
  give(t, plan_of(1, t, 10, 1, t));
  EXPECT_EQ(fly(t).sequence, 1U);
  give(t + 10 * ms, plan_of(2, t + 100 * ms, 10, 2, t));
  EXPECT_EQ(fly(t + 99 * ms).sequence, 1U);
  EXPECT_EQ(fly(t + 100 * ms).sequence, 2U);
  EXPECT_EQ(admission.counters().applied, 2U);
}

TEST_F(PlayoutTest, AnOlderPlanIsNeverFlownAfterANewerOneEvenWhenItLastsLonger) {
  give(t, plan_of(1, t, 40, 1, t));
  fly(t);
  give(t, plan_of(2, t + 50 * ms, 2, 2, t));
  EXPECT_EQ(fly(t + 60 * ms).sequence, 2U);
  EXPECT_FALSE(fly(t + 400 * ms).valid);
}

TEST_F(PlayoutTest, ABurstIsFlownPlanByPlanInOrder) {
  for (std::uint64_t i = 0; i < 5; ++i) give(t, plan_of(i + 1, t + static_cast<TimeNs>(i) * 33 * ms, 4, 1, t));
  std::uint64_t last = 0;
  for (TimeNs now = t; now < t + 300 * ms; now += ms) {
    const auto setpoint = fly(now);
    if (!setpoint.valid) continue;
    EXPECT_GE(setpoint.sequence, last);
    last = setpoint.sequence;
  }
  EXPECT_EQ(admission.counters().applied, 5U);
  expect_sums();
}

TEST_F(PlayoutTest, OfTwoPlansDueAtOnceTheNewerIsFlownAndTheOlderIsSuperseded) {
  give(t, plan_of(1, t, 4, 1, t - ms));
  give(t, plan_of(2, t, 4, 2, t));
  EXPECT_EQ(fly(t).sequence, 2U);
  EXPECT_EQ(admission.counters().dropped_by[static_cast<std::size_t>(DropReason::superseded)], 1U);
  expect_sums();
}

TEST_F(PlayoutTest, APlanThatComesAfterItsTimeIsLate) {
  give(t, plan_of(1, t - 500 * ms, 4, 1, t - 600 * ms));
  EXPECT_FALSE(fly(t).valid);
  EXPECT_EQ(admission.counters().late, 1U);
  expect_sums();
}

TEST_F(PlayoutTest, APlanWhoseTimePassedUnnoticedIsLateToo) {
  give(t, plan_of(1, t + 10 * ms, 2, 1, t));
  EXPECT_FALSE(fly(t + 900 * ms).valid);
  EXPECT_EQ(admission.counters().late, 1U);
  expect_sums();
}

TEST_F(PlayoutTest, APlanThatComesInItsMiddleIsFlownFromThere) {
  Plan plan = plan_of(1, t - 80 * ms, 4, 1, t - 90 * ms);
  plan.setpoints[1].velocity_mps[0] = 7;
  give(t, plan);
  EXPECT_EQ(fly(t).velocity.mps[0], 7);
}

TEST_F(PlayoutTest, AFullQueueGivesUpAPlanAndSaysSo) {
  for (std::uint64_t i = 0; i < 70; ++i) give(t, plan_of(i + 1, t + static_cast<TimeNs>(i + 1) * 50 * ms, 4, 1, t));
  EXPECT_EQ(admission.counters().dropped_by[static_cast<std::size_t>(DropReason::queue_full)], 6U);
  for (TimeNs now = t; now < t + 4 * ns_per_s; now += ms) fly(now);
  EXPECT_EQ(admission.counters().applied, 64U);
  expect_sums();
}

TEST_F(PlayoutTest, WherePlansComeLateSetpointsAndTheEndAreLaterByTheMargin) {
  for (std::uint64_t sequence = 1; sequence <= 300; ++sequence) {
    give(t, plan_of(sequence, t - 80 * ms, 10, 1, t - 80 * ms));
    for (const TimeNs next = t + 33 * ms; t < next; t += ms) fly(t);
  }
  EXPECT_EQ(playout.margin_ns(), 80 * ms);
  give(t, plan_of(301, t - 70 * ms, 10, 2, t - 70 * ms));
  EXPECT_EQ(fly(t + 9 * ms).velocity.mps[0], 1);
  EXPECT_EQ(fly(t + 10 * ms).velocity.mps[0], 2);
  EXPECT_FALSE(fly(t + 10 * ms + 500 * ms).valid) << "the plan's end is as much later, not more";
  expect_sums();
}

}  // namespace
}  // namespace ledgerline::link
