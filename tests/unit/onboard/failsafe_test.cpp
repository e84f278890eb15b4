#include "onboard/link/failsafe.hpp"

#include <gtest/gtest.h>
#include "tests/unit/onboard/times.hpp"

namespace ledgerline::link {
namespace {

/// A flight in which all is well, until a test takes something away.
class FailsafeTest : public ::testing::Test {
 protected:
  FailsafeTest() {
    facts.phase = FlightPhase::flying;
    facts.flying_since_ns = now;
    facts.plan_valid = true;
    facts.ledger_alive = true;
    facts.position_m = {0, 0, 1};
    facts.height_m = 1;
    facts.battery = 0.8F;
  }
  void pass(TimeNs duration) {
    for (const TimeNs end = now + duration; now < end;) {
      now += ms;
      if (beats) facts.beat_ns = now;
      if (states) facts.state_ns = now;
      if (poses) facts.pose_ns = now;
      if (facts.plan_valid) facts.covered_until_ns = now + 10 * ms;
      const FailsafeMode before = state.mode;
      state = update(settings, fence, state, now, facts);
      if (state.mode != before) ++changes;
    }
  }
  void expect(FailsafeMode mode, FailsafeCause cause) const {
    EXPECT_EQ(state.mode, mode);
    EXPECT_EQ(state.cause, cause);
  }

  FailsafeSettings settings;
  FenceSettings fence;
  FailsafeFacts facts;
  FailsafeState state;
  TimeNs now = 100 * ns_per_s;
  bool beats = true, states = true, poses = true;
  int changes = 0;
};

TEST_F(FailsafeTest, WhileAllIsWellThePlanIsFlown) {
  pass(10 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  EXPECT_EQ(changes, 0);
}

TEST_F(FailsafeTest, APlanThatRanOutMeansHoldThenLand) {
  pass(ns_per_s);
  facts.plan_valid = false;
  pass(settings.hold_grace_ns + 20 * ms);
  expect(FailsafeMode::hold, FailsafeCause::plan_ran_out);
  pass(settings.land_after_ns - 100 * ms);
  expect(FailsafeMode::hold, FailsafeCause::plan_ran_out);
  pass(200 * ms);
  expect(FailsafeMode::land, FailsafeCause::held_too_long);
  EXPECT_EQ(changes, 2);
}

TEST_F(FailsafeTest, ANewPlanEndsTheHold) {
  pass(ns_per_s);
  facts.plan_valid = false;
  pass(3 * ns_per_s);
  facts.plan_valid = true;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  facts.plan_valid = false;
  pass(3 * ns_per_s);  // the clock of the hold began anew
  expect(FailsafeMode::hold, FailsafeCause::plan_ran_out);
}

TEST_F(FailsafeTest, TakingOffGivesNoFreeTime) {
  facts.plan_valid = false;
  facts.covered_until_ns = 0;
  pass(settings.hold_grace_ns + ms);
  expect(FailsafeMode::hold, FailsafeCause::plan_ran_out);
  pass(settings.land_after_ns);
  expect(FailsafeMode::land, FailsafeCause::held_too_long);
}

TEST_F(FailsafeTest, WithASilentAgentThePlanInHandIsFlownToItsEnd) {
  beats = false;
  pass(2 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  facts.plan_valid = false;
  pass(ns_per_s);
  expect(FailsafeMode::hold, FailsafeCause::agent_silent);
  pass(settings.land_after_ns);
  expect(FailsafeMode::land, FailsafeCause::agent_silent);
}

TEST_F(FailsafeTest, ADeadAgentTakesThePosesAlongAndItsPlanIsStillFlownToItsEnd) {
  pass(ns_per_s);
  beats = poses = false;
  pass(2 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  facts.plan_valid = false;
  pass(ns_per_s);
  expect(FailsafeMode::hold, FailsafeCause::agent_silent);
  pass(settings.land_after_ns);
  expect(FailsafeMode::land, FailsafeCause::agent_silent);
}

TEST_F(FailsafeTest, ASilentLedgerIsToldApartFromASilentAgent) {
  facts.ledger_alive = false;
  pass(2 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  facts.plan_valid = false;
  pass(ns_per_s);
  expect(FailsafeMode::hold, FailsafeCause::ledger_silent);
  pass(settings.land_after_ns);
  expect(FailsafeMode::land, FailsafeCause::ledger_silent);
}

TEST_F(FailsafeTest, StaleStateTextMeansBrakeThenLand) {
  pass(ns_per_s);
  states = false;
  pass(settings.state_stale_ns + 2 * ms);
  expect(FailsafeMode::brake, FailsafeCause::state_stale);
  pass(settings.land_after_ns);
  expect(FailsafeMode::land, FailsafeCause::state_stale);
}

TEST_F(FailsafeTest, ALostPoseMeansBrakeThenLand) {
  pass(ns_per_s);
  poses = false;
  pass(settings.pose_lost_ns + 2 * ms);
  expect(FailsafeMode::brake, FailsafeCause::pose_lost);
  pass(settings.land_after_ns);
  expect(FailsafeMode::land, FailsafeCause::pose_lost);
}

TEST_F(FailsafeTest, ABrakeEndsOnlyWhenItsCauseHasBeenAwayForAWhile) {
  pass(ns_per_s);
  poses = false;
  pass(ns_per_s);
  poses = true;
  pass(settings.clear_after_ns - 10 * ms);
  expect(FailsafeMode::brake, FailsafeCause::pose_lost);
  pass(20 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, APoseThatComesAndGoesDoesNotMakeModesFlap) {
  pass(ns_per_s);
  for (int i = 0; i < 6; ++i) {
    poses = false;
    pass(settings.pose_lost_ns + 50 * ms);
    poses = true;
    pass(settings.clear_after_ns / 2);
  }
  expect(FailsafeMode::brake, FailsafeCause::pose_lost);
  EXPECT_EQ(changes, 1);
}

TEST_F(FailsafeTest, ABrakeIntoAHoldDoesNotRestartTheClock) {
  pass(ns_per_s);
  poses = false;
  facts.plan_valid = false;
  pass(settings.land_after_ns / 2);
  poses = true;
  pass(settings.land_after_ns / 2 - 100 * ms);
  EXPECT_EQ(state.mode, FailsafeMode::hold);
  pass(settings.pose_lost_ns + 200 * ms);
  EXPECT_EQ(state.mode, FailsafeMode::land);
}

TEST_F(FailsafeTest, OutsideTheFenceAndInwardIsAllowed) {
  facts.position_m = {fence.max_m[0] + 0.3, 0, 1};
  facts.velocity_mps = {-0.5, 0, 0};
  pass(10 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::fence);
}

TEST_F(FailsafeTest, OutsideTheFenceAndStillOutwardMeansLand) {
  facts.position_m = {0, fence.min_m[1] - 0.3, 1};
  facts.velocity_mps = {0, -0.5, 0};
  pass(settings.fence_land_after_ns - 10 * ms);
  expect(FailsafeMode::none, FailsafeCause::fence);
  pass(20 * ms);
  expect(FailsafeMode::land, FailsafeCause::fence);
}

TEST_F(FailsafeTest, FarOutsideTheFenceMeansLandAtAnySpeed) {
  facts.position_m = {0, 0, fence.max_m[2] + fence.far_beyond_m + 0.1};
  pass(settings.fence_land_after_ns + 2 * ms);
  expect(FailsafeMode::land, FailsafeCause::fence);
}

TEST_F(FailsafeTest, WithoutAPoseTheHeightAloneIsFenced) {
  pass(ns_per_s);
  poses = false;
  facts.position_m = {1000, 1000, 1000};
  pass(settings.pose_lost_ns + settings.fence_land_after_ns + 100 * ms);
  expect(FailsafeMode::brake, FailsafeCause::pose_lost);
  facts.height_m = static_cast<float>(fence.max_m[2]) + 0.1F;
  pass(settings.fence_land_after_ns + 2 * ms);
  expect(FailsafeMode::land, FailsafeCause::fence);
}

TEST_F(FailsafeTest, ALowBatteryWarnsAndTheWarningDoesNotFlap) {
  facts.battery = settings.battery_low;
  pass(100 * ms);
  expect(FailsafeMode::none, FailsafeCause::battery_low);
  facts.battery = settings.battery_low + settings.battery_margin / 2;
  pass(100 * ms);
  expect(FailsafeMode::none, FailsafeCause::battery_low);
  facts.battery = settings.battery_low + 2 * settings.battery_margin;
  pass(100 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, ACriticalBatteryLands) {
  facts.battery = settings.battery_critical;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::battery_critical);
}

TEST_F(FailsafeTest, AStopLandsAtOnceWhateverElseIsWrong) {
  pass(ns_per_s);
  poses = states = beats = false;
  pass(2 * ns_per_s);
  facts.stop = true;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::stopped);
}

TEST_F(FailsafeTest, MotorsAreCutOnlyWhereAskedForByName) {
  facts.stop = true;
  pass(20 * ns_per_s);
  EXPECT_EQ(state.mode, FailsafeMode::land);
  facts.cut = true;
  pass(ms);
  expect(FailsafeMode::cut, FailsafeCause::stopped);
}

TEST_F(FailsafeTest, ALandingIsNeverTakenBackInTheAir) {
  facts.battery = settings.battery_critical;
  pass(ms);
  facts.battery = 1;
  facts.phase = FlightPhase::landing;
  pass(10 * ns_per_s);
  expect(FailsafeMode::land, FailsafeCause::battery_critical);
  facts.phase = FlightPhase::landed;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, AStopOutlastsTheLanding) {
  facts.stop = true;
  pass(ms);
  facts.phase = FlightPhase::landed;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::stopped);
}

TEST_F(FailsafeTest, OnTheGroundTheCauseSaysWhatATakeOffWaitsFor) {
  facts.phase = FlightPhase::on_ground;
  facts.ledger_alive = false;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::ledger_silent);
  facts.ledger_alive = true;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, TakeOffIsRefusedWithTheCauseThatSpeaksAgainstIt) {
  const auto refusal = [&](auto spoil) {
    FailsafeFacts spoiled = facts;
    spoiled.beat_ns = spoiled.state_ns = spoiled.pose_ns = now;
    spoil(spoiled);
    return takeoff_refusal(settings, now, spoiled);
  };
  EXPECT_EQ(refusal([](FailsafeFacts&) {}), FailsafeCause::none);
  EXPECT_EQ(refusal([](FailsafeFacts& f) { f.stop = true; }), FailsafeCause::stopped);
  EXPECT_EQ(refusal([](FailsafeFacts& f) { f.battery = 0.1F; }), FailsafeCause::battery_low);
  EXPECT_EQ(refusal([](FailsafeFacts& f) { f.state_ns = 0; }), FailsafeCause::state_stale);
  EXPECT_EQ(refusal([](FailsafeFacts& f) { f.pose_ns -= ns_per_s; }), FailsafeCause::pose_lost);
  EXPECT_EQ(refusal([](FailsafeFacts& f) { f.beat_ns -= ns_per_s; }), FailsafeCause::agent_silent);
  EXPECT_EQ(refusal([](FailsafeFacts& f) { f.ledger_alive = false; }), FailsafeCause::ledger_silent);
}

TEST_F(FailsafeTest, TheSetpointIsClippedAtTheFenceAndOnlyOutward) {
  const Velocity wish{{1, 1, 1}, 0.5F};
  const Velocity at = clip_at_fence(fence, {fence.max_m[0], 0, 1}, wish);
  EXPECT_EQ(at.mps[0], 0);
  EXPECT_EQ(at.mps[1], 1);
  EXPECT_EQ(at.yaw_radps, 0.5F);
  EXPECT_LT(clip_at_fence(fence, {fence.max_m[0] - 0.2, 0, 1}, wish).mps[0], 0.5F);
  EXPECT_EQ(clip_at_fence(fence, {fence.min_m[0] - 3, 0, 1}, wish).mps[0], 1);             // leads back
  EXPECT_EQ(clip_at_fence(fence, {fence.min_m[0] - 3, 0, 1}, {{-1, 0, 0}, 0}).mps[0], 0);  // leads out
  EXPECT_EQ(clip_at_fence(fence, {0, 0, fence.max_m[2] + 0.5}, wish).mps[2], 0);
}

}  // namespace
}  // namespace ledgerline::link
