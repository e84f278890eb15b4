#include "onboard/link/core/failsafe.hpp"
#include "common/base/enum_count.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "common/msg/names.hpp"
#include "tests/unit/onboard/link/core/failsafe_fixture.hpp"

namespace ledgerline::link {
namespace {

TEST_F(FailsafeTest, WhileAllIsWellThePlanIsFlown) {
  pass(10 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  EXPECT_EQ(changes, 0);
}

TEST_F(FailsafeTest, FS10APlanThatRanOutMeansHoldUntilThereIsOne) {
  pass(ns_per_s);
  inputs.plan_valid = false;
  pass(settings.hold_grace_ns - 20 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);  // link ramps to zero already
  pass(40 * ms);
  expect(FailsafeMode::hold, FailsafeCause::plan_ran_out);
  pass(3 * ns_per_s);
  expect(FailsafeMode::hold, FailsafeCause::plan_ran_out);
  inputs.plan_valid = true;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  EXPECT_EQ(changes, 2);
}

TEST_F(FailsafeTest, FS05AHoldOrBrakeOfLandAfterMeansLand) {
  pass(ns_per_s);
  inputs.plan_valid = false;
  pass(3 * ns_per_s);
  inputs.plan_valid = true;
  pass(ms);
  inputs.plan_valid = false;
  pass(settings.hold_grace_ns + settings.land_after_ns - 100 * ms);  // the clock of the hold restarted
  expect(FailsafeMode::hold, FailsafeCause::plan_ran_out);
  pass(200 * ms);
  expect(FailsafeMode::land, FailsafeCause::held_too_long);
  inputs.plan_valid = true;
  pass(ns_per_s);
  expect(FailsafeMode::land, FailsafeCause::held_too_long);
  inputs.phase = LinkPhase::landed;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, FS14AnUntrustedLedgerLandsWhereTheConfigSaysSo) {
  inputs.ledger_untrusted = true;
  pass(ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);  // what cannot be trusted is left out anyway
  settings.on_untrusted_ledger = OnUntrustedLedger::land;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::ledger_untrusted);
}

TEST_F(FailsafeTest, FS15AnUntrustedLedgerBrakesUntilItIsTrustedForAWhileWhereTheConfigSaysSo) {
  settings.on_untrusted_ledger = OnUntrustedLedger::hold;
  inputs.ledger_untrusted = true;
  pass(ms);
  expect(FailsafeMode::brake, FailsafeCause::ledger_untrusted);
  inputs.ledger_untrusted = false;
  pass(settings.clear_after_ns);
  expect(FailsafeMode::brake, FailsafeCause::ledger_untrusted);
  pass(2 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.ledger_untrusted = true;
  pass(settings.land_after_ns + ms);
  expect(FailsafeMode::land, FailsafeCause::ledger_untrusted);
}

TEST_F(FailsafeTest, TakingOffGivesNoFreeTime) {
  inputs.plan_valid = false;
  inputs.covered_until_ns = 0;
  pass(settings.hold_grace_ns + ms);
  expect(FailsafeMode::hold, FailsafeCause::plan_ran_out);
  pass(settings.land_after_ns);
  expect(FailsafeMode::land, FailsafeCause::held_too_long);
}

TEST_F(FailsafeTest, FS08WithASilentAgentThePlanInHandIsFlownToItsEndThenHold) {
  heartbeats = false;
  pass(2 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.plan_valid = false;
  pass(ns_per_s);
  expect(FailsafeMode::hold, FailsafeCause::agent_silent);
  inputs.plan_valid = true;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.plan_valid = false;
  pass(settings.land_after_ns + ns_per_s);
  expect(FailsafeMode::land, FailsafeCause::agent_silent);
}

TEST_F(FailsafeTest, ADeadAgentTakesThePosesAlongAndItsPlanIsStillFlownToItsEnd) {
  pass(ns_per_s);
  heartbeats = poses = false;
  pass(2 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.plan_valid = false;
  pass(ns_per_s);
  expect(FailsafeMode::hold, FailsafeCause::agent_silent);
  pass(settings.land_after_ns);
  expect(FailsafeMode::land, FailsafeCause::agent_silent);
}

TEST_F(FailsafeTest, FS09WithASilentLedgerThePlanInHandIsFlownToItsEndThenHold) {
  inputs.ledger_alive = false;
  pass(2 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.plan_valid = false;
  pass(ns_per_s);
  expect(FailsafeMode::hold, FailsafeCause::ledger_silent);
  inputs.plan_valid = true;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  inputs.plan_valid = false;
  pass(settings.land_after_ns + ns_per_s);
  expect(FailsafeMode::land, FailsafeCause::ledger_silent);
}

TEST_F(FailsafeTest, FS06StaleStateTextMeansBrakeUntilItIsBackForAWhile) {
  pass(ns_per_s);
  states = false;
  pass(settings.state_stale_ns + 2 * ms);
  expect(FailsafeMode::brake, FailsafeCause::state_stale);
  states = true;
  pass(settings.clear_after_ns - 10 * ms);
  expect(FailsafeMode::brake, FailsafeCause::state_stale);
  pass(20 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  states = false;
  pass(settings.state_stale_ns + settings.land_after_ns + 4 * ms);
  expect(FailsafeMode::land, FailsafeCause::state_stale);
}

TEST_F(FailsafeTest, OneLonelyStateTextDoesNotEndABrake) {
  pass(ns_per_s);
  states = false;
  pass(settings.state_stale_ns + 2 * ms);
  expect(FailsafeMode::brake, FailsafeCause::state_stale);
  states = true;
  pass(ms);
  states = false;
  for (int i = 0; i < 900; ++i) {
    pass(ms);
    expect(FailsafeMode::brake, FailsafeCause::state_stale);
  }
}

TEST_F(FailsafeTest, FS07ALostPoseMeansBrakeUntilItIsBackForAWhile) {
  pass(ns_per_s);
  poses = false;
  pass(settings.pose_lost_ns + 2 * ms);
  expect(FailsafeMode::brake, FailsafeCause::pose_lost);
  poses = true;
  pass(settings.clear_after_ns - 10 * ms);
  expect(FailsafeMode::brake, FailsafeCause::pose_lost);
  pass(20 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
  poses = false;
  pass(settings.pose_lost_ns + settings.land_after_ns + 4 * ms);
  expect(FailsafeMode::land, FailsafeCause::pose_lost);
}

TEST_F(FailsafeTest, ASilenceThatComesAndGoesDoesNotMakeTheCauseFlap) {
  settings.land_after_ns = 60 * ns_per_s;
  pass(ns_per_s);
  inputs.plan_valid = false;
  for (int i = 0; i < 10; ++i) {
    heartbeats = false;
    pass(settings.agent_silent_ns + 100 * ms);
    heartbeats = true;
    pass(settings.clear_after_ns / 4);
  }
  expect(FailsafeMode::hold, FailsafeCause::agent_silent);
  EXPECT_EQ(changes, 1);
  EXPECT_EQ(causes, 2) << "first it only lacked a plan";
  pass(settings.clear_after_ns);
  expect(FailsafeMode::hold, FailsafeCause::plan_ran_out);
}

TEST_F(FailsafeTest, TheSilencesOfLedgerAgentAndDroneAreDistinguished) {
  const auto after = [&](bool ledger, bool agent, bool drone) {
    state = {};
    inputs.phase = LinkPhase::flying;
    inputs.ledger_alive = heartbeats = poses = states = inputs.plan_valid = true;
    pass(ns_per_s);
    inputs.ledger_alive = ledger;
    heartbeats = poses = agent;  // poses come through agent
    states = drone;
    inputs.plan_valid = false;
    pass(settings.state_stale_ns + 100 * ms);
    return std::pair(state.mode, state.cause);
  };
  using Report = std::pair<FailsafeMode, FailsafeCause>;
  EXPECT_EQ(after(true, true, true), Report(FailsafeMode::hold, FailsafeCause::plan_ran_out));
  EXPECT_EQ(after(false, true, true), Report(FailsafeMode::hold, FailsafeCause::ledger_silent));
  EXPECT_EQ(after(true, false, true), Report(FailsafeMode::hold, FailsafeCause::agent_silent));
  EXPECT_EQ(after(true, true, false), Report(FailsafeMode::brake, FailsafeCause::state_stale));
  EXPECT_EQ(after(false, false, true), Report(FailsafeMode::hold, FailsafeCause::agent_silent));
  EXPECT_EQ(after(false, false, false), Report(FailsafeMode::brake, FailsafeCause::state_stale));
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
  inputs.plan_valid = false;
  pass(settings.land_after_ns / 2);
  poses = true;
  pass(settings.land_after_ns / 2 - 100 * ms);
  EXPECT_EQ(state.mode, FailsafeMode::hold);
  pass(settings.pose_lost_ns + 200 * ms);
  EXPECT_EQ(state.mode, FailsafeMode::land);
}

TEST_F(FailsafeTest, FS11BeyondTheFenceWhatLeadsBackIsFlownWithAWarning) {
  inputs.position_m = {fence.max_m[0] + 0.3, 0, 1};
  inputs.velocity_mps = {-0.5, 0, 0};
  pass(10 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::fence);
  EXPECT_TRUE(follows_plan(state.mode, inputs.plan_valid));
  inputs.position_m = {fence.max_m[0] - 0.3, 0, 1};
  pass(settings.clear_after_ns - 10 * ms);
  expect(FailsafeMode::none, FailsafeCause::fence);
  pass(20 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, TheWarningDoesNotFlapAtTheFence) {
  inputs.velocity_mps = {};
  for (int i = 0; i < 200; ++i) {
    inputs.position_m = {fence.max_m[0] + (i % 2 == 0 ? 0.02 : -0.02), 0, 1};
    pass(10 * ms);
  }
  expect(FailsafeMode::none, FailsafeCause::fence);
  EXPECT_EQ(causes, 1);
}

TEST_F(FailsafeTest, FS04BeyondTheFenceAndStillOutwardMeansLand) {
  inputs.position_m = {0, fence.min_m[1] - 0.3, 1};
  inputs.velocity_mps = {0, -0.5, 0};
  pass(settings.fence_land_after_ns - 10 * ms);
  expect(FailsafeMode::none, FailsafeCause::fence);
  pass(20 * ms);
  expect(FailsafeMode::land, FailsafeCause::fence);
  inputs.position_m = {0, 0, 1};
  pass(10 * ns_per_s);
  expect(FailsafeMode::land, FailsafeCause::fence);
  inputs.phase = LinkPhase::landed;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, FarOutsideTheFenceMeansLandAtAnySpeed) {
  inputs.position_m = {0, 0, fence.max_m[2] + fence.far_beyond_m + 0.1};
  pass(settings.fence_land_after_ns + 2 * ms);
  expect(FailsafeMode::land, FailsafeCause::fence);
}

TEST_F(FailsafeTest, TheDronesOwnHeightHoldsTheCeilingWhateverThePoseSays) {
  inputs.height_m = static_cast<float>(fence.max_m[2]) + 0.4F;
  inputs.velocity_mps = {};
  pass(2 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::fence);  // the setpoint's upward part is clipped
  inputs.velocity_mps = {0, 0, 0.5};
  pass(settings.fence_land_after_ns + 2 * ms);
  expect(FailsafeMode::land, FailsafeCause::fence);
}

TEST_F(FailsafeTest, FarAboveTheCeilingByItsOwnHeightMeansLandAtAnySpeed) {
  inputs.height_m = static_cast<float>(fence.max_m[2] + fence.far_beyond_m) + 0.3F;
  inputs.velocity_mps = {};
  pass(settings.fence_land_after_ns + 2 * ms);
  expect(FailsafeMode::land, FailsafeCause::fence);
}

TEST_F(FailsafeTest, AStepOfItsOwnHeightJustBelowTheCeilingIsNoReasonToWarnOrLand) {
  for (const double ceiling : {1.5, 2.0, 2.7, 3.0}) {
    fence.max_m[2] = ceiling;
    inputs.position_m = {0, 0, ceiling - 0.01};
    inputs.velocity_mps = {0, 0, 0.5};
    for (int i = 0; i < 100; ++i) {
      inputs.height_m = static_cast<float>(ceiling) + (i % 2 == 0 ? 0.1F : 0);
      pass(20 * ms);
      expect(FailsafeMode::none, FailsafeCause::none);
    }
  }
}

TEST_F(FailsafeTest, WithoutAPoseTheHeightAloneIsFenced) {
  pass(ns_per_s);
  poses = false;
  inputs.position_m = {1000, 1000, 1000};
  pass(settings.pose_lost_ns + settings.fence_land_after_ns + 100 * ms);
  expect(FailsafeMode::brake, FailsafeCause::pose_lost);
  inputs.height_m = static_cast<float>(fence.max_m[2]) + 0.1F;
  pass(settings.fence_land_after_ns + 2 * ms);
  expect(FailsafeMode::land, FailsafeCause::fence);
}

TEST_F(FailsafeTest, FS12ALowBatteryWarnsAndTheWarningDoesNotFlap) {
  inputs.battery = settings.battery_low;
  pass(100 * ms);
  expect(FailsafeMode::none, FailsafeCause::battery_low);
  inputs.battery = settings.battery_low + settings.battery_margin / 2;
  pass(100 * ms);
  expect(FailsafeMode::none, FailsafeCause::battery_low);
  inputs.battery = settings.battery_low + 2 * settings.battery_margin;
  pass(100 * ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, FS03ACriticalBatteryLands) {
  inputs.battery = settings.battery_critical;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::battery_critical);
}

TEST_F(FailsafeTest, FS67AFailedCheckLandsAllDrones) {
  inputs.check_failed = true;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::check_failed);
}

TEST_F(FailsafeTest, FS02AStopLandsAtOnceWhateverElseIsWrong) {
  pass(ns_per_s);
  poses = states = heartbeats = false;
  pass(2 * ns_per_s);
  inputs.stop = true;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::stopped);
}

TEST_F(FailsafeTest, FS01MotorsAreCutOnlyWhereAskedForByName) {
  inputs.stop = true;
  pass(20 * ns_per_s);
  EXPECT_EQ(state.mode, FailsafeMode::land);
  inputs.cut = true;
  pass(ms);
  expect(FailsafeMode::cut, FailsafeCause::stopped);
  inputs.cut = inputs.stop = false;
  pass(ns_per_s);
  expect(FailsafeMode::cut, FailsafeCause::stopped);
  inputs.phase = LinkPhase::landed;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, FS13ADroneThatMayBeAirborneIsLandedWhenItsHandshakesFailed) {
  inputs.phase = LinkPhase::disconnected;
  inputs.may_be_airborne = true;
  states = false;
  pass(3 * ns_per_s);
  expect(FailsafeMode::none, FailsafeCause::state_stale);
  inputs.contact_lost = true;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::state_stale);
  inputs.contact_lost = false;  // it is seen again, in the air
  inputs.may_be_airborne = false;
  inputs.phase = LinkPhase::landing;
  states = true;
  pass(ns_per_s);
  expect(FailsafeMode::land, FailsafeCause::state_stale);
  inputs.phase = LinkPhase::disconnected;  // and lost, but on the ground
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, AStopACutAndTheFenceActOnADroneThatMayBeAirborne) {
  inputs.phase = LinkPhase::disconnected;
  inputs.stop = true;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::stopped);
  inputs.may_be_airborne = true;
  pass(ms);
  expect(FailsafeMode::land, FailsafeCause::stopped);
  inputs.cut = true;
  pass(ms);
  expect(FailsafeMode::cut, FailsafeCause::stopped);
  state = {};
  inputs.stop = inputs.cut = false;
  inputs.position_m = {fence.max_m[0] + 2, 0, 1};
  pass(settings.fence_land_after_ns + 10 * ms);
  expect(FailsafeMode::land, FailsafeCause::fence);
}

TEST_F(FailsafeTest, ALandingIsNeverTakenBackInTheAir) {
  inputs.battery = settings.battery_critical;
  pass(ms);
  inputs.battery = 1;
  inputs.phase = LinkPhase::landing;
  pass(10 * ns_per_s);
  expect(FailsafeMode::land, FailsafeCause::battery_critical);
  inputs.phase = LinkPhase::landed;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, AStopOutlastsTheLanding) {
  inputs.stop = true;
  pass(ms);
  inputs.phase = LinkPhase::landed;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::stopped);
}

TEST_F(FailsafeTest, OnTheGroundTheCauseSaysWhatATakeOffWaitsFor) {
  inputs.phase = LinkPhase::on_ground;
  inputs.ledger_alive = false;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::ledger_silent);
  inputs.ledger_alive = true;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::none);
}

TEST_F(FailsafeTest, ATakeOffThatTheDroneRefusedIsSaidAndMayBeTriedAgain) {
  inputs.phase = LinkPhase::on_ground;
  inputs.takeoff_refused_by_drone = true;
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::takeoff_refused_by_drone);
  EXPECT_EQ(takeoff_refusal(settings, fence, now, inputs), FailsafeCause::none);
  inputs.ledger_alive = false;  // what link waits for comes first
  pass(ms);
  expect(FailsafeMode::none, FailsafeCause::ledger_silent);
}

TEST_F(FailsafeTest, TakeOffIsRefusedWithTheCauseThatSpeaksAgainstIt) {
  const auto refusal = [&](auto spoil) {
    FailsafeInputs spoiled = inputs;
    spoiled.heartbeat_ns = spoiled.state_ns = spoiled.pose_ns = now;
    spoil(spoiled);
    return takeoff_refusal(settings, fence, now, spoiled);
  };
  EXPECT_EQ(refusal([](FailsafeInputs&) {}), FailsafeCause::none);
  EXPECT_EQ(refusal([](FailsafeInputs& f) { f.stop = true; }), FailsafeCause::stopped);
  EXPECT_EQ(refusal([](FailsafeInputs& f) { f.battery = 0.1F; }), FailsafeCause::battery_low);
  EXPECT_EQ(refusal([](FailsafeInputs& f) { f.state_ns = 0; }), FailsafeCause::state_stale);
  EXPECT_EQ(refusal([](FailsafeInputs& f) { f.pose_ns -= ns_per_s; }), FailsafeCause::pose_lost);
  EXPECT_EQ(refusal([](FailsafeInputs& f) { f.heartbeat_ns -= ns_per_s; }), FailsafeCause::agent_silent);
  EXPECT_EQ(refusal([](FailsafeInputs& f) { f.ledger_alive = false; }), FailsafeCause::ledger_silent);
  settings.on_untrusted_ledger = OnUntrustedLedger::hold;
  EXPECT_EQ(refusal([](FailsafeInputs& f) { f.ledger_untrusted = true; }), FailsafeCause::ledger_untrusted);
}

TEST_F(FailsafeTest, TheSetpointIsClippedAtTheFenceAndOnlyOutward) {
  const Velocity desired{{1, 1, 1}, 0.5F};
  const Velocity at = clip_at_fence(fence, {fence.max_m[0], 0, 1}, 1, desired, 0);
  EXPECT_EQ(at.mps[0], 0);
  EXPECT_EQ(at.mps[1], 1);
  EXPECT_EQ(at.yaw_radps, 0.5F);
  // With a push it goes back, slowly, and not up from the floor.
  EXPECT_EQ(clip_at_fence(fence, {fence.max_m[0] + 1, 0, 1}, 1, desired, 0.3F).mps[0], -0.3F);
  EXPECT_EQ(clip_at_fence(fence, {fence.min_m[0] - 1, 0, 1}, 1, {}, 0.3F).mps[0], 0.3F);
  EXPECT_EQ(clip_at_fence(fence, {0, 0, fence.min_m[2] - 0.1}, 0, {}, 0.3F).mps[2], 0);
  EXPECT_EQ(clip_at_fence(fence, {0, 0, 1}, static_cast<float>(fence.max_m[2]) + 1, {}, 0.3F).mps[2], 0);
  EXPECT_LT(clip_at_fence(fence, {fence.max_m[0] - 0.2, 0, 1}, 1, desired, 0).mps[0], 0.5F);
  EXPECT_EQ(clip_at_fence(fence, {fence.min_m[0] - 3, 0, 1}, 1, desired, 0).mps[0], 1);          // leads back
  EXPECT_EQ(clip_at_fence(fence, {fence.min_m[0] - 3, 0, 1}, 1, {{-1, 0, 0}, 0}, 0).mps[0], 0);  // leads out
  EXPECT_EQ(clip_at_fence(fence, {0, 0, fence.max_m[2] + 0.5}, 1, desired, 0).mps[2], 0);
}

TEST_F(FailsafeTest, TheSetpointsUpwardPartIsClippedByTheDronesOwnHeightToo) {
  const auto ceiling = static_cast<float>(fence.max_m[2]);
  EXPECT_EQ(clip_at_fence(fence, {0, 0, 1}, 1, {{0, 0, 1}, 0}, 0).mps[2], 1);
  EXPECT_EQ(clip_at_fence(fence, {0, 0, 1}, ceiling, {{0, 0, 1}, 0}, 0).mps[2], 0);
  EXPECT_LT(clip_at_fence(fence, {0, 0, 1}, ceiling - 0.2F, {{0, 0, 1}, 0}, 0).mps[2], 0.5F);
  EXPECT_EQ(clip_at_fence(fence, {0, 0, 1}, ceiling + 1, {{1, 0, -1}, 0}, 0).mps[2], -1) << "down it may always go";
  EXPECT_EQ(clip_at_fence(fence, {0, 0, 1}, ceiling + 1, {{1, 0, -1}, 0}, 0).mps[0], 1);
}

// ---- docs/failsafe.md says what is true

/// The cells of every line of a table in docs/failsafe.md whose first cell begins with FS-, by that cell.
std::map<std::string, std::vector<std::string>> requirements() {
  std::map<std::string, std::vector<std::string>> lines;
  std::ifstream page(LEDGERLINE_SOURCE "/docs/failsafe.md");
  for (std::string line; std::getline(page, line);) {
    std::vector<std::string> cells;
    std::stringstream rest(line);
    for (std::string cell; std::getline(rest, cell, '|');) {
      std::string text;
      for (const char c : cell) {
        if (c != '`') text += c;
      }
      const auto first = text.find_first_not_of(' ');
      cells.push_back(first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(' ') - first + 1));
    }
    if (cells.size() < 2 || !cells[1].starts_with("FS-")) continue;
    EXPECT_TRUE(lines.emplace(cells[1], std::vector(cells.begin() + 2, cells.end())).second)
        << cells[1] << " is there twice";
  }
  return lines;
}

std::set<std::string> tests_of_this_suite() {
  std::set<std::string> names;
  const auto* suite = ::testing::UnitTest::GetInstance()->current_test_suite();
  for (int i = 0; i < suite->total_test_count(); ++i) names.insert(suite->GetTestInfo(i)->name());
  return names;
}

TEST_F(FailsafeTest, ThePageTheTableAndTheTestsAgree) {
  auto page = requirements();
  const std::set<std::string> tests = tests_of_this_suite();
  std::set<std::string> of_rows;
  for (const FailsafeRow& row : failsafe_table) {
    const auto line = page.find(row.id);
    ASSERT_NE(line, page.end()) << row.id << " is not on the page";
    ASSERT_EQ(line->second.size(), 5U) << row.id;
    EXPECT_EQ(line->second[0], ledgerline::name(row.cause)) << row.id;
    EXPECT_EQ(line->second[1], ledgerline::name(row.mode)) << row.id;
    EXPECT_EQ(line->second[3], row.clears.name) << row.id;
    const std::string test = line->second[4];
    EXPECT_TRUE(test.starts_with("FS" + std::string(row.id).substr(3))) << test << " is not named after " << row.id;
    EXPECT_TRUE(tests.count(test)) << "there is no test " << test;
    of_rows.insert(test);
    page.erase(line);
  }
  for (const std::string& test : tests) {
    if (test.starts_with("FS")) {
      EXPECT_TRUE(of_rows.count(test)) << test << " is a test of no row";
    }
  }
  EXPECT_FALSE(page.empty()) << "what is required besides the rows";
  for (const auto& [id, cells] : page) ASSERT_EQ(cells.size(), 2U) << id << " is no row of the table";
}

TEST_F(FailsafeTest, EveryTestThatThePageNamesExists) {
  std::string sources;
  for (const auto& file : std::filesystem::recursive_directory_iterator(LEDGERLINE_SOURCE "/tests/unit")) {
    if (file.path().extension() != ".cpp") continue;
    std::stringstream text;
    text << std::ifstream(file.path()).rdbuf();
    sources += text.str();
  }
  for (const auto& [id, cells] : requirements()) {
    if (cells.size() != 2) continue;  // rows are looked at above
    std::stringstream names(cells[1]);
    int count = 0;
    for (std::string test; std::getline(names >> std::ws, test, ',');) {
      const auto dot = test.find('.');
      ASSERT_NE(dot, std::string::npos) << id << ": " << test;
      const std::string written = "(" + test.substr(0, dot) + ", " + test.substr(dot + 1) + ")";
      EXPECT_NE(sources.find(written), std::string::npos) << id << ": there is no test " << test;
      ++count;
    }
    EXPECT_GT(count, 0) << id;
  }
}

}  // namespace
}  // namespace ledgerline::link
