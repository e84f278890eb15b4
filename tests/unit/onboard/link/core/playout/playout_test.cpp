#include "onboard/link/core/playout/playout.hpp"

#include <gtest/gtest.h>

#include <limits>
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

/// A plan of `count` setpoints 50 ms apart from `at`, flying x at `speed`.
Plan plan_of(std::uint64_t sequence, TimeNs at, std::uint32_t count, float speed, TimeNs stamp) {
  Plan plan;
  plan.drone = 1;
  plan.epoch = 1;
  plan.sequence = sequence;
  plan.state_stamp_ns = stamp;
  plan.count = count;
  for (std::uint32_t i = 0; i < count; ++i) plan.setpoints[i] = {at + i * 50 * ms, {speed, 0, 0}, 0};
  return plan;
}

class PlayoutTest : public ::testing::Test {
 protected:
  DropReason give(TimeNs now, const Plan& plan) {
    const DropReason reason = playout.admit(now, plan);
    if (reason == DropReason::none) playout.add(now, plan);
    return reason;
  }
  /// Flies what is wished at `now`, as LinkCore would.
  Playout::Wish fly(TimeNs now) {
    const Playout::Wish wish = playout.wish(now);
    if (wish.valid) playout.mark_sent();
    return wish;
  }
  void expect_sums() {
    playout.clear(DropReason::superseded);
    const PlanCounters& c = playout.counters();
    EXPECT_EQ(c.received, c.applied + c.late + c.dropped);
    std::uint32_t by_reason = 0;
    for (const std::uint32_t n : c.dropped_by) by_reason += n;
    EXPECT_EQ(c.dropped, by_reason);
  }

  PlayoutSettings settings;
  Playout playout{settings};
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
  EXPECT_EQ(playout.counters().applied, 1U);
}

TEST_F(PlayoutTest, APlanInHandFillsTheGapUntilItsSuccessorIsDue) {
  give(t, plan_of(1, t, 10, 1, t));
  EXPECT_EQ(fly(t).sequence, 1U);
  give(t + 10 * ms, plan_of(2, t + 100 * ms, 10, 2, t));
  EXPECT_EQ(fly(t + 99 * ms).sequence, 1U);
  EXPECT_EQ(fly(t + 100 * ms).sequence, 2U);
  EXPECT_EQ(playout.counters().applied, 2U);
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
    const auto wish = fly(now);
    if (!wish.valid) continue;
    EXPECT_GE(wish.sequence, last);
    last = wish.sequence;
  }
  EXPECT_EQ(playout.counters().applied, 5U);
  expect_sums();
}

TEST_F(PlayoutTest, OfTwoPlansDueAtOnceTheNewerIsFlownAndTheOlderIsSuperseded) {
  give(t, plan_of(1, t, 4, 1, t - ms));
  give(t, plan_of(2, t, 4, 2, t));
  EXPECT_EQ(fly(t).sequence, 2U);
  EXPECT_EQ(playout.counters().dropped_by[static_cast<std::size_t>(DropReason::superseded)], 1U);
  expect_sums();
}

TEST_F(PlayoutTest, ReplayedAndReorderedPlansAreDropped) {
  give(t, plan_of(5, t, 4, 1, t));
  EXPECT_EQ(give(t, plan_of(5, t, 4, 1, t)), DropReason::out_of_order);
  EXPECT_EQ(give(t, plan_of(4, t, 4, 1, t)), DropReason::out_of_order);
  Plan next_lease = plan_of(1, t, 4, 1, t);
  next_lease.epoch = 2;
  EXPECT_EQ(give(t, next_lease), DropReason::none);
  EXPECT_EQ(give(t, plan_of(9, t, 4, 1, t)), DropReason::out_of_order);  // of the old lease
  expect_sums();
}

TEST_F(PlayoutTest, APlanMadeFromTooOldAStateIsDropped) {
  EXPECT_EQ(give(t, plan_of(1, t, 4, 1, t - settings.max_age_ns - ms)), DropReason::too_old);
  EXPECT_EQ(give(t, plan_of(2, t, 4, 1, t - settings.max_age_ns + ms)), DropReason::none);
  expect_sums();
}

TEST_F(PlayoutTest, ALandingIsNeverTooOld) {
  Plan plan = plan_of(1, t, 0, 0, t - 100 * ns_per_s);
  plan.action = PlanAction::land;
  EXPECT_EQ(playout.admit(t, plan), DropReason::none);
}

TEST_F(PlayoutTest, AStopIsInNobodysSequence) {
  give(t, plan_of(5, t, 4, 1, t));
  Plan stop = plan_of(0, t, 0, 0, 0);
  stop.action = PlanAction::stop;
  stop.epoch = 0;
  EXPECT_EQ(playout.admit(t, stop), DropReason::none);
  EXPECT_EQ(give(t, plan_of(6, t, 4, 1, t)), DropReason::none);
}

TEST_F(PlayoutTest, APlanThatComesAfterItsTimeIsLate) {
  give(t, plan_of(1, t - 500 * ms, 4, 1, t - 600 * ms));
  EXPECT_FALSE(fly(t).valid);
  EXPECT_EQ(playout.counters().late, 1U);
  expect_sums();
}

TEST_F(PlayoutTest, APlanWhoseTimePassedUnseenIsLateToo) {
  give(t, plan_of(1, t + 10 * ms, 2, 1, t));
  EXPECT_FALSE(fly(t + 900 * ms).valid);
  EXPECT_EQ(playout.counters().late, 1U);
  expect_sums();
}

TEST_F(PlayoutTest, APlanThatComesInItsMiddleIsFlownFromThere) {
  Plan plan = plan_of(1, t - 80 * ms, 4, 1, t - 90 * ms);
  plan.setpoints[1].velocity_mps[0] = 7;
  give(t, plan);
  EXPECT_EQ(fly(t).velocity.mps[0], 7);
}

TEST_F(PlayoutTest, BadNumbersAreDroppedNotFlown) {
  std::uint64_t sequence = 0;
  const auto refused = [&](auto spoil) {
    Plan plan = plan_of(++sequence, t, 4, 1, t);
    spoil(plan);
    return give(t, plan) == DropReason::bad_value;
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
  EXPECT_TRUE(refused([](Plan& p) { p.setpoints[2].at_ns = p.setpoints[1].at_ns; }));
  EXPECT_TRUE(refused([](Plan& p) { p.setpoints[0].at_ns = -1; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.setpoints[3].at_ns = t + 100 * ns_per_s; }));
  EXPECT_TRUE(refused([&](Plan& p) { p.state_stamp_ns = t + ms; }));
  EXPECT_FALSE(fly(t).valid);
  expect_sums();
}

TEST_F(PlayoutTest, AFullQueueGivesUpAPlanAndSaysSo) {
  for (std::uint64_t i = 0; i < 70; ++i) give(t, plan_of(i + 1, t + static_cast<TimeNs>(i + 1) * 50 * ms, 4, 1, t));
  EXPECT_EQ(playout.counters().dropped_by[static_cast<std::size_t>(DropReason::queue_full)], 6U);
  for (TimeNs now = t; now < t + 4 * ns_per_s; now += ms) fly(now);
  EXPECT_EQ(playout.counters().applied, 64U);
  expect_sums();
}

TEST_F(PlayoutTest, EveryPlanThatEndsUnflownIsNamedWithItsReason) {
  give(t, plan_of(1, t - 900 * ms, 2, 1, t - 900 * ms));
  give(t, plan_of(1, t, 2, 1, t));
  ASSERT_EQ(playout.ends().size(), 2U);
  EXPECT_EQ(playout.ends()[0].reason, DropReason::none);
  EXPECT_EQ(playout.ends()[1].reason, DropReason::out_of_order);
}

/// Plans 33 ms apart that come `late` after the time of their first setpoint; the wish is asked for every ms.
class MarginTest : public PlayoutTest {
 protected:
  void plans(int count, TimeNs late) {
    for (int i = 0; i < count; ++i) {
      give(t, plan_of(++sequence, t - late, 10, 1, t - late));
      for (const TimeNs next = t + 33 * ms; t < next; t += ms) {
        fly(t);
        EXPECT_GE(t - playout.margin_ns(), time) << "the time of playout never goes back";
        time = t - playout.margin_ns();
      }
    }
  }
  std::uint64_t sequence = 0;
  TimeNs time = 0;
};

TEST_F(MarginTest, PlansThatComeInTimeAreFlownAtTheirTime) {
  plans(300, -5 * ms);
  EXPECT_EQ(playout.margin_ns(), 0);
}

TEST_F(MarginTest, PlansThatComeLateAreFlownLaterByAsMuch) {
  plans(300, 80 * ms);
  EXPECT_EQ(playout.margin_ns(), 80 * ms);
  give(t, plan_of(++sequence, t - 70 * ms, 10, 2, t - 70 * ms));
  EXPECT_EQ(fly(t + 9 * ms).velocity.mps[0], 1);
  EXPECT_EQ(fly(t + 10 * ms).velocity.mps[0], 2);
  EXPECT_FALSE(fly(t + 10 * ms + 500 * ms).valid) << "the plan's end is as much later, not more";
  expect_sums();
}

TEST_F(MarginTest, AFewLatePlansAreNotWaitedFor) {
  for (int i = 0; i < 6; ++i) {
    plans(60, 0);
    plans(1, 300 * ms);
  }
  EXPECT_EQ(playout.margin_ns(), 0);
}

TEST_F(MarginTest, TheMarginEndsAtItsLimitAndGoesWhenPlansComeInTimeAgain) {
  plans(300, 1'500 * ms);
  EXPECT_EQ(playout.margin_ns(), settings.max_margin_ns);
  plans(900, 0);
  EXPECT_EQ(playout.margin_ns(), 0);
}

TEST_F(MarginTest, ALimitOfZeroMeansNone) {
  settings.max_margin_ns = 0;
  playout = Playout(settings);
  plans(300, 80 * ms);
  EXPECT_EQ(playout.margin_ns(), 0);
}

}  // namespace
}  // namespace ledgerline::link
