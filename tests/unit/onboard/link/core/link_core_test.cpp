#include "onboard/link/core/link_core.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <map>
#include <numbers>

#include "tests/unit/onboard/link/core/link_world.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

TEST(LinkCore, FliesAWholeFlightFromHandshakeToLanding) {
  LinkWorld w;
  w.take_off();
  ASSERT_EQ(w.core.phase(1), LinkPhase::flying);
  for (int i = 0; i < 60; ++i) {
    w.fly_plan({0.5F, 0, 0});
    w.pass(33 * ms);
  }
  EXPECT_NEAR(w.tellos[0].position[0], 0.5 * 2, 0.15);
  w.plan(PlanAction::land);
  w.pass(5 * ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landed);
  EXPECT_EQ(w.tellos[0].count("takeoff"), 1);
  EXPECT_TRUE(w.core.all_on_ground());
  w.core.finish();
  const DroneReport report = w.core.reports()[0];
  EXPECT_TRUE(report.landed);
  EXPECT_EQ(report.plans.received, 62U);
  EXPECT_EQ(report.plans.applied, 62U);
  EXPECT_EQ(report.age_ms.count, 60U);
}

TEST(LinkCore, AFailedCheckLandsTheDroneAndNoneTakesOffAfterwards) {
  LinkWorld w;
  w.take_off();
  w.core.step(w.now - ms, {});
  EXPECT_NE(w.core.checks().first().find("time does not go back"), std::string::npos) << w.core.checks().first();
  w.pass(5 * ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landed);
  EXPECT_EQ(w.states.back().cause, FailsafeCause::check_failed);
  w.plan(PlanAction::takeoff);
  w.pass(5 * ns_per_s);
  EXPECT_EQ(w.tellos[0].count("takeoff"), 1);
}

TEST(LinkCore, AFailedCheckOfAgentLandsTheDronesOfAllItsChannels) {
  LinkWorld w(2);
  w.take_off();
  const AgentHeartbeat heartbeat{
      .stamp_ns = w.now, .drones = AgentHeartbeat::bit_of(1), .ledger_alive = true, .check_failed = true};
  LinkInputs inputs;
  inputs.heartbeats = {&heartbeat, 1};
  w.core.step(w.now, inputs);
  w.pass(8 * ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landed);
  EXPECT_EQ(w.core.phase(2), LinkPhase::landed);
}

TEST(LinkCore, ADroneYawedByNinetyDegreesGetsTheRcForItsOwnFrame) {
  LinkWorld w;
  w.tellos[0].yaw = std::numbers::pi / 2;
  w.take_off();
  for (int i = 0; i < 40; ++i) {
    w.fly_plan({0.4F, 0, 0});
    w.pass(50 * ms);
  }
  EXPECT_EQ(w.tellos[0].rc, (std::array<int, 4>{40, 0, 0, 0}));  // east is on the right of a drone that looks north
  EXPECT_GT(w.tellos[0].position[0], 0.5);
  EXPECT_NEAR(w.tellos[0].position[1], 0, 0.02);
}

TEST(LinkCore, RcIsSentAtOnceWhenANewPlansSetpointIsDueElseEveryFiftyMilliseconds) {
  LinkWorld w;
  w.take_off();
  w.fly_plan({0, 0, 0}, 20);
  w.pass(10 * ms);
  w.sent.clear();
  w.fly_plan({0, 0, 0}, 20, 7 * ms);
  const TimeNs due = w.now + 7 * ms;
  w.pass(7 * ms);
  ASSERT_FALSE(w.sent.empty());
  EXPECT_EQ(w.sent.back().first, due);
  w.sent.clear();
  w.pass(ns_per_s);
  TimeNs last = due;
  for (const auto& [at, text] : w.sent) {
    EXPECT_GE(at - last, w.settings_.rc.min_gap_ns);
    EXPECT_LE(at - last, w.settings_.rc.max_gap_ns);
    last = at;
  }
  EXPECT_GE(w.sent.size(), 19U);
}

TEST(LinkCore, AgeAtApplicationIsFromTheStateToTheFirstSetpointSent) {
  LinkWorld w;
  w.take_off();
  for (int i = 0; i < 50; ++i) {
    Plan& plan = w.fly_plan({0.2F, 0, 0}, 10, 5 * ms);
    plan.state_stamp_ns = w.now - 15 * ms;
    w.pass(30 * ms);
  }
  const Quantiles age = w.core.reports()[0].age_ms;
  EXPECT_EQ(age.count, 50U);
  EXPECT_NEAR(age.median, 20, 1);
  EXPECT_NEAR(age.max, 20, 1);
  const StateSample& state = w.states.back();
  EXPECT_EQ(state.applied_sequence, w.sequence);
  EXPECT_EQ(state.playout_margin_ns, 0);
  EXPECT_EQ(state.plans_applied, 51U);
}

TEST(LinkCore, StatesSayWhenTheNewestPlanCameWhetherItIsFlownOrNot) {
  LinkWorld w;
  w.take_off();
  Plan& plan = w.fly_plan({0.2F, 0, 0}, 10, 2 * ns_per_s);
  const std::uint64_t early = plan.sequence;
  const TimeNs came_ns = w.now;
  w.pass(100 * ms);
  EXPECT_EQ(w.states.back().arrived_sequence, early);
  EXPECT_NEAR(to_ms(w.states.back().arrived_ns - came_ns), 0, 2);
  EXPECT_LT(w.states.back().applied_sequence, early);
  (void)w.fly_plan({0.2F, 0, 0}, 2, -1 * ns_per_s);  // over already
  w.pass(100 * ms);
  EXPECT_EQ(w.states.back().arrived_sequence, early + 1);
}

TEST(LinkCore, AttitudeAndAccelerationAreReportedInRep103sSigns) {
  LinkWorld w;
  // Right side down, nose up, turned clockwise; pushed forward and to the right, and at rest against gravity.
  w.tellos[0].attitude_text = "pitch:10;roll:20;yaw:30;agx:100;agy:200;agz:-1000;";
  w.pass(2000 * ms);
  const StateSample& state = w.states.back();
  constexpr float rad_per_deg = std::numbers::pi_v<float> / 180;
  EXPECT_FLOAT_EQ(state.attitude_rad[0], 20 * rad_per_deg);
  EXPECT_FLOAT_EQ(state.attitude_rad[1], -10 * rad_per_deg);
  EXPECT_FLOAT_EQ(state.attitude_rad[2], -30 * rad_per_deg);
  EXPECT_FLOAT_EQ(state.acceleration_mps2[0], 0.980665F);
  EXPECT_FLOAT_EQ(state.acceleration_mps2[1], -1.96133F);
  EXPECT_FLOAT_EQ(state.acceleration_mps2[2], 9.80665F);
}

TEST(LinkCore, StatesComeAtTheirRateWithBootIdAndWithoutAGapInTheSequence) {
  LinkSettings settings;
  settings.rate_hz = 50;
  LinkWorld w(3, settings);
  w.pass(2 * ns_per_s);
  ASSERT_EQ(w.states.size(), 3 * 100U);
  for (std::size_t i = 0; i < w.states.size(); ++i) {
    EXPECT_EQ(w.states[i].drone, i % 3 + 1);
    EXPECT_EQ(w.states[i].sequence, i / 3 + 1);
    EXPECT_EQ(w.states[i].boot_id, 42U);
    EXPECT_EQ(w.states[i].stamp_ns, w.states[i / 3 * 3].stamp_ns);
  }
}

TEST(LinkCore, SilenceFromEverybodyEndsInZeroThenLanding) {
  LinkWorld w;
  w.take_off();
  w.fly_plan({1, 0, 0}, 20);
  w.pass(900 * ms);
  EXPECT_GT(w.tellos[0].rc[1], 80);
  w.agent = w.mocap = false;
  w.pass(ns_per_s);
  EXPECT_EQ(w.tellos[0].rc, (std::array<int, 4>{}));
  w.pass(w.settings_.failsafe.land_after_ns + 5 * ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landed);
}

TEST(LinkCore, WithASilentDroneLinkBrakesAndLandsByAnswersAlone) {
  LinkWorld w;
  w.take_off();
  w.tellos[0].states = false;
  for (int i = 0; i < 300 && w.core.mode(1) == FailsafeMode::none; ++i) {
    w.fly_plan({0.5F, 0, 0});
    w.pass(33 * ms);
  }
  EXPECT_EQ(w.core.mode(1), FailsafeMode::brake);
  w.pass(500 * ms);
  EXPECT_TRUE(w.tellos[0].keeps_place());
  w.pass(w.settings_.failsafe.land_after_ns + 5 * ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::disconnected);  // landed, then silent on the ground
  EXPECT_EQ(w.tellos[0].motion, FakeTello::Motion::ground);
}

TEST(LinkCore, PlansDuringABrakeAreDroppedAndNotFlownLater) {
  LinkWorld w;
  w.take_off();
  w.fly_plan({0.5F, 0, 0}, 40);
  w.pass(100 * ms);
  w.mocap = false;
  w.pass(w.settings_.failsafe.pose_lost_ns + 60 * ms);
  ASSERT_EQ(w.core.mode(1), FailsafeMode::brake);
  w.fly_plan({1, 0, 0}, 40);
  w.pass(200 * ms);
  w.mocap = true;
  w.pass(ns_per_s);
  EXPECT_EQ(w.tellos[0].rc, (std::array<int, 4>{}));
  EXPECT_EQ(w.core.reports()[0].plans.dropped_by[static_cast<std::size_t>(DropReason::not_flying)], 1U);
}

TEST(LinkCore, TheFenceHoldsAgainstAPlanThatLeavesIt) {
  LinkSettings settings;
  settings.fence.max_m = {2, 2, 3};
  LinkWorld w(1, settings);
  w.take_off();
  for (int i = 0; i < 300; ++i) {
    w.fly_plan({1, 0, 1});
    w.pass(33 * ms);
    ASSERT_LE(w.tellos[0].position[0], 2.0);
    ASSERT_LE(w.tellos[0].position[2], 3.0);
    ASSERT_EQ(w.core.mode(1), FailsafeMode::none) << "it clips before it acts";
  }
  EXPECT_GT(w.tellos[0].position[0], 1.8);
  EXPECT_EQ(w.core.phase(1), LinkPhase::flying);
}

TEST(LinkCore, TheFenceHoldsEvenWhenAgentDiesWithItsPosesAndThePlanGoesOn) {
  LinkSettings settings;
  settings.fence.max_m = {1, 2, 3};
  LinkWorld w(1, settings);
  w.take_off();
  w.fly_plan({1, 0, 0}, 40);
  w.pass(300 * ms);
  w.agent = w.mocap = false;
  w.pass(1600 * ms);
  EXPECT_EQ(w.core.mode(1), FailsafeMode::none);
  EXPECT_GT(w.tellos[0].position[0], 0.7);
  EXPECT_LE(w.tellos[0].position[0], 1.05);
}

TEST(LinkCore, AStopLandsAndOnceClearedOnlyATakeOffFromALaterStateFliesAgain) {
  LinkWorld w;
  w.take_off();
  Plan& stop = w.plan(PlanAction::stop);
  stop.sequence = 0;
  stop.epoch = 0;
  w.pass(ms);
  EXPECT_EQ(w.core.mode(1), FailsafeMode::land);
  for (int i = 0; i < 5000 && w.core.phase(1) != LinkPhase::landed; ++i) w.step();
  ASSERT_EQ(w.core.phase(1), LinkPhase::landed);
  Plan& before =
      w.plan(PlanAction::takeoff);  // of an operator who did not know yet, and still young enough to be flown
  before.state_stamp_ns = w.now - 500 * ms;
  w.pass(3 * ns_per_s);
  EXPECT_EQ(w.tellos[0].count("takeoff"), 1);
  EXPECT_EQ(w.core.reports()[0].plans.dropped_by[static_cast<std::size_t>(DropReason::too_old)], 1U);
  w.plan(PlanAction::stop_cleared);
  w.plan(PlanAction::takeoff);
  w.pass(5 * ns_per_s);
  EXPECT_EQ(w.tellos[0].count("takeoff"), 2);
}

TEST(LinkCore, ACutIsAnEmergencyAndNothingLess) {
  LinkWorld w;
  w.take_off();
  w.plan(PlanAction::cut);
  w.pass(10 * ms);
  EXPECT_EQ(w.tellos[0].count("emergency"), 1);
  w.pass(2 * ns_per_s);
  EXPECT_EQ(w.core.phase(1), LinkPhase::landed);
}

TEST(LinkCore, TheLocalStopKeyLandsAllDrones) {
  LinkWorld w(3);
  w.take_off();
  w.pass(100 * ms);
  EXPECT_FALSE(w.core.all_on_ground());
  w.stop_all = true;
  w.pass(5 * ns_per_s);
  EXPECT_TRUE(w.core.all_on_ground());
  for (const DroneReport& report : w.core.reports()) EXPECT_TRUE(report.landed);
  w.plan(PlanAction::takeoff);
  w.pass(ns_per_s);
  EXPECT_TRUE(w.core.all_on_ground());
}

TEST(LinkCore, EachDroneFliesItsOwnPlans) {
  LinkWorld w(2);
  w.take_off();
  for (int i = 0; i < 40; ++i) {
    w.fly_plan({0.5F, 0, 0}, 10, 0, 1);
    w.fly_plan({0, 0.5F, 0}, 10, 0, 2);
    w.pass(33 * ms);
  }
  EXPECT_GT(w.tellos[0].position[0], 0.4);
  EXPECT_NEAR(w.tellos[0].position[1], 0, 0.01);
  EXPECT_GT(w.tellos[1].position[1], 0.4);
  EXPECT_NEAR(w.tellos[1].position[0], 3, 0.01);
}

TEST(LinkCore, TakeOffIsRefusedWithoutAPoseOrALivingAgent) {
  LinkWorld w;
  w.mocap = false;
  w.pass(ns_per_s);
  w.plan(PlanAction::takeoff);
  w.pass(100 * ms);
  EXPECT_EQ(w.tellos[0].count("takeoff"), 0);
  w.mocap = true;
  w.agent = false;
  w.pass(ns_per_s);
  w.plan(PlanAction::takeoff);
  w.pass(100 * ms);
  EXPECT_EQ(w.tellos[0].count("takeoff"), 0);
  EXPECT_EQ(w.core.reports()[0].plans.dropped, 2U);
}

TEST(LinkCore, NoRcButZerosOfTheHandshakeIsSentOnTheGroundAndNoneInTakeOffAndInLanding) {
  LinkWorld w;
  w.pass(ns_per_s);
  w.plan(PlanAction::takeoff);
  w.pass(500 * ms);
  w.fly_plan({1, 0, 0});
  w.pass(500 * ms);
  // But one with the handshake, and one behind it: the drone may fly by an rc of a link that is gone, also a hand above
  // the ground.
  std::vector<std::string> rcs;
  for (const auto& [at, text] : w.sent) {
    if (text.starts_with("rc")) rcs.push_back(text);
  }
  EXPECT_EQ(rcs, (std::vector<std::string>{"rc 0 0 0 0", "rc 0 0 0 0"}));
  EXPECT_EQ(w.core.reports()[0].plans.dropped_by[static_cast<std::size_t>(DropReason::not_flying)], 1U);
}

TEST(LinkCore, AStutteringLinkStopsTheDroneAndThenKeepsSilentSoThatItLandsByItself) {
  LinkWorld w;
  w.take_off();
  w.fly_plan({1, 0, 0}, 40);
  w.pass(ns_per_s);
  w.now += 400 * ms;  // this process was not run
  w.sent.clear();
  w.pass(w.settings_.health_rest_ns - 10 * ms);
  ASSERT_EQ(w.sent.size(), 1U);
  EXPECT_EQ(w.sent[0].second, "rc 0 0 0 0");
  w.pass(500 * ms);
  EXPECT_GT(w.sent.size(), 5U);  // healthy again: hold keeps the drone awake
}

// What a drone kept before it landed is no place to fly to when it takes off elsewhere.
TEST(LinkCore, APlaceOfAnEarlierFlightIsNotFlownTo) {
  LinkWorld w;
  w.take_off();
  w.pass(2 * ns_per_s);  // no plan: it stays
  w.plan(PlanAction::land);
  w.pass(10 * ns_per_s);
  ASSERT_EQ(w.tellos[0].motion, FakeTello::Motion::ground);
  w.tellos[0].position[0] += 0.4;  // carried
  w.pass(ns_per_s);
  w.take_off();
  const double there_m = w.tellos[0].position[0];
  w.pass(2 * ns_per_s);
  EXPECT_NEAR(w.tellos[0].position[0], there_m, 0.05);
}

// Agent's, when a lease has ended.
TEST(LinkCore, AnEmptyPlanEndsWhatIsFlownAndTheNextHoldersPlanIsFlown) {
  LinkWorld w;
  w.take_off();
  w.fly_plan({1, 0, 0}, 40);
  w.pass(500 * ms);
  ASSERT_GT(w.tellos[0].rc[1], 50);
  Plan& empty = w.plan(PlanAction::fly);
  empty.epoch = 2;
  empty.sequence = 0;
  w.step();
  EXPECT_EQ(w.core.mode(1), FailsafeMode::hold);
  w.pass(500 * ms);
  const auto stays = [&] { return w.tellos[0].keeps_place(); };
  EXPECT_TRUE(stays());
  w.fly_plan({1, 0, 0}, 40);  // the loser's, that comes late
  w.pass(100 * ms);
  EXPECT_TRUE(stays());
  Plan& next = w.fly_plan({1, 0, 0}, 40);
  next.epoch = 2;
  next.sequence = 1;
  w.pass(500 * ms);
  EXPECT_GT(w.tellos[0].rc[1], 50);
  w.core.finish();
  const PlanCounters counters = w.core.reports()[0].plans;
  EXPECT_EQ(counters.received, counters.applied + counters.late + counters.dropped);
}

// A laptop that sleeps, a virtual machine that is paused: CLOCK_MONOTONIC shows no gap.
TEST(LinkCore, AHostThatWasSuspendedFliesNoPlanAndNoPoseOfBefore) {
  LinkWorld w;
  w.take_off();
  w.fly_plan({1, 0, 0}, 40);
  w.pass(500 * ms);
  ASSERT_GT(w.tellos[0].rc[1], 50);
  const TimeNs before = w.now;
  Plan on_its_way = w.fly_plan({1, 0, 0}, 40);
  w.plans.clear();
  w.suspended_ns = 2 * ns_per_s;
  w.sent.clear();
  w.mocap = false;
  w.pass(100 * ms);
  EXPECT_EQ(w.core.mode(1), FailsafeMode::brake) << "its pose is 2 s old";
  w.mocap = true;
  w.pass(w.settings_.health_rest_ns - 200 * ms);
  ASSERT_EQ(w.sent.size(), 1U);
  EXPECT_EQ(w.sent[0].second, "rc 0 0 0 0");
  w.pass(w.settings_.failsafe.clear_after_ns + 300 * ms);
  ASSERT_EQ(w.core.mode(1), FailsafeMode::hold);
  w.plans.push_back(on_its_way);  // it was in a queue meanwhile; young enough, by a clock that stood still
  w.plans.back().state_stamp_ns = before - 10 * ms;
  w.pass(100 * ms);
  EXPECT_EQ(w.tellos[0].rc[1], 0);
  w.fly_plan({1, 0, 0}, 40);
  w.pass(500 * ms);
  EXPECT_GT(w.tellos[0].rc[1], 50) << "a plan of now is flown";
}

TEST(LinkCore, WhatTheTwoClocksDifferByInEverydayIsNoSuspend) {
  LinkWorld w;
  w.suspended_ns = 5 * ns_per_s;  // the laptop slept yesterday
  w.take_off();
  w.fly_plan({1, 0, 0}, 40);
  for (int i = 0; i < 500; ++i) {
    w.suspended_ns += i % 2 == 0 ? 40 * ms : -40 * ms;  // read one behind the other
    w.step();
  }
  EXPECT_GT(w.tellos[0].rc[1], 50);
}

TEST(LinkCore, ALinkThatIsStartedAgainInTheAirBeginsWithZeroAndWithinItsLimits) {
  LinkWorld w;
  w.take_off();
  w.fly_plan({1, 0, 0}, 20);
  w.pass(900 * ms);
  ASSERT_GT(w.tellos[0].rc[1], 80);
  w.core = LinkCore(w.settings_, 43);
  w.sent.clear();
  w.pass(300 * ms);
  ASSERT_EQ(w.core.phase(1), LinkPhase::flying);
  EXPECT_EQ(w.states.back().boot_id, 43U);
  ASSERT_GE(w.sent.size(), 2U);
  EXPECT_EQ(w.sent[0].second, "command");
  for (std::size_t i = 1; i < w.sent.size(); ++i) EXPECT_EQ(w.sent[i].second, "rc 0 0 0 0");
  w.sent.clear();
  const TimeNs begin = w.now;
  w.fly_plan({1, 0, 0}, 20);
  w.pass(500 * ms);
  EXPECT_GT(w.tellos[0].rc[1], 80);
  for (const auto& [at, text] : w.sent) {
    int right = 0, forward = 0;
    ASSERT_EQ(std::sscanf(text.c_str(), "rc %d %d", &right, &forward), 2) << text;
    EXPECT_LE(forward, 100 * w.settings_.playout.max_acceleration_mps2 * to_seconds(at - begin) + 1);
  }
}

TEST(LinkCore, PlansAndPosesThatAreNotForItsDronesOrNotFiniteAreIgnored) {
  LinkWorld w;
  w.take_off();
  w.plan(PlanAction::land, 1).drone = 9;
  w.plan(PlanAction::land, 1).drone = 0;
  const double nan = std::nan("");
  const std::vector<Pose> poses{
      {.drone = 1, .stamp_ns = w.now, .position_m = {nan, 0, 0}, .velocity_mps = {}, .yaw_rad = 0},
      {.drone = 1, .stamp_ns = w.now, .position_m = {}, .velocity_mps = {}, .yaw_rad = nan},
      {.drone = 1, .stamp_ns = w.now + ns_per_s, .position_m = {5, 5, 5}, .velocity_mps = {}, .yaw_rad = 0},
      {.drone = 77, .stamp_ns = w.now, .position_m = {}, .velocity_mps = {}, .yaw_rad = 0}};
  w.core.step(w.now, {.received = {}, .plans = {}, .poses = poses, .heartbeats = {}});
  w.pass(100 * ms);
  EXPECT_EQ(w.core.phase(1), LinkPhase::flying);
  EXPECT_LT(w.states.back().position_m[0], 1);
}

TEST(LinkCore, TheTraceNamesEveryPlanOnce) {
  LinkWorld w;
  w.take_off();
  for (int i = 0; i < 30; ++i) {
    w.fly_plan({0.5F, 0, 0}, 4, (i % 3) * 20 * ms);
    if (i % 5 == 0) w.plans.push_back(w.plans.back());
    w.pass(30 * ms);
  }
  w.pass(ns_per_s);
  const PlanCounters plans = w.core.reports()[0].plans;
  std::uint32_t received = 0, applied = 0, ended = 0;
  for (const TraceRecord& record : w.trace) {
    received += record.kind == TraceKind::plan_received;
    applied += record.kind == TraceKind::command_applied;
    ended += record.kind == TraceKind::refused;
  }
  EXPECT_EQ(received, w.sequence + 6) << "six were handed over twice";
  EXPECT_EQ(applied, plans.applied);
  EXPECT_EQ(ended, plans.dropped + plans.late);
  EXPECT_EQ(plans.received, plans.applied + plans.dropped + plans.late);
}

// The variances that were traced, by the number of their state.
std::map<std::uint64_t, TraceRecord> reported_in(const LinkWorld& world) {
  std::map<std::uint64_t, TraceRecord> sent;
  for (const TraceRecord& record : world.trace)
    if (record.kind == TraceKind::pose_reported) sent.emplace(record.id, record);
  return sent;
}

TEST(LinkCore, TheTraceHasTheVarianceOfEachStateThatTellsOne) {
  LinkSettings settings;
  settings.drones.push_back({.name = "tello1", .number = 1, .source = PoseSource::tello});
  LinkWorld w(1, settings);
  w.mocap = false;
  w.tellos[0].attitude_text = "pitch:0;roll:0;yaw:0;vgx:0;vgy:0;vgz:0;";
  w.pass(2 * ns_per_s);
  const auto sent = reported_in(w);
  std::size_t with_variance = 0;
  for (const StateSample& state : w.states) {
    const bool tells = state.pose_variance != PoseVariance{};
    ASSERT_EQ(sent.contains(state.sequence), tells) << state.sequence;
    if (!tells) continue;
    ++with_variance;
    const TraceRecord& record = sent.at(state.sequence);
    EXPECT_EQ(record.t_ns, state.stamp_ns);
    EXPECT_EQ(record.stamp_ns, state.pose_stamp_ns);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_EQ(record.v[i], static_cast<double>(state.pose_variance[i]));
  }
  EXPECT_GT(with_variance, 20u);
}

TEST(LinkCore, OfMotionCaptureNoVarianceIsTraced) {
  LinkWorld w;
  w.take_off();
  EXPECT_TRUE(reported_in(w).empty());
}

}  // namespace
}  // namespace ledgerline::link
