#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <deque>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using testing::HasSubstr;
using Kind = fabric::Outcome::Kind;

/// Blocks and outcomes by hand, one drone's states at a time.
class FlightByHand : public testing::Test {
 protected:
  explicit FlightByHand(int drones = 3) : core(config_for(drones)) {
    for (const auto& drone : core.drones()) {
      EXPECT_TRUE(core.set_control(control_record(drone.name, operator_name).SerializeAsString()));
    }
  }

  FlightOutputs block(fabric::Transaction tx) {
    fabric::Block block;
    block.transactions.push_back(std::move(tx));
    FlightInputs inputs;
    inputs.block = &block;
    return core.step(now_ns, inputs);
  }
  /// A new state of each of the drones, on the ground: each wants a TAKEOFF plan.
  FlightOutputs states(std::initializer_list<int> drones, std::uint64_t applied = 0) {
    now_ns += 5 * ns_per_ms;
    SetCall call;
    for (int k : drones) {
      StateSample sample;
      sample.phase = LinkPhase::on_ground;
      sample.boot_id = 9;
      sample.sequence = ++sequence;
      sample.stamp_ns = sample.pose_stamp_ns = now_ns;
      sample.applied_sequence = applied;
      add_state(call, "tello" + std::to_string(k), sample);
    }
    return block(event("set", call.SerializeAsString()));
  }
  /// The same in flight, at that height: from the second on each wants a FLY plan.
  FlightOutputs flying(std::initializer_list<int> drones, double height_m, std::uint64_t arrived = 0,
                       TimeNs arrived_ns = 0) {
    now_ns += 5 * ns_per_ms;
    SetCall call;
    for (int k : drones) {
      StateSample sample;
      sample.phase = LinkPhase::flying;
      sample.boot_id = 9;
      sample.sequence = ++sequence;
      sample.stamp_ns = sample.pose_stamp_ns = now_ns;
      sample.position_m = {0, 0, height_m};
      sample.arrived_sequence = arrived;
      sample.arrived_ns = arrived_ns;
      add_state(call, "tello" + std::to_string(k), sample);
    }
    return block(event("set", call.SerializeAsString()));
  }
  void new_lease_of_tello1() {
    Controls controls;
    *controls.add_controls() = control_record("tello1", operator_name, 2);
    (void)block(control_event("acquire", {"tello1"}, controls.SerializeAsString()));
  }
  /// What tello1 will be commanded then, upward, as the predictor has it.
  double sent_mps(TimeNs meant_ns) const { return core.controller(0)->predictor().until(meant_ns).sent_mps().z(); }
  FlightOutputs outcome(std::uint64_t id, Kind kind, const std::string& message = "", bool more = false) {
    const fabric::Outcome outcome = fabric::Outcome::failed(kind, message);
    FlightInputs inputs;
    inputs.outcome = &outcome;
    inputs.outcome_id = id;
    inputs.more = more;
    return core.step(now_ns, inputs);
  }
  static CommandCall call_of(const FlightOutputs& out) {
    CommandCall call;
    EXPECT_EQ(out.submissions.size(), 1u);
    if (!out.submissions.empty()) {
      EXPECT_EQ(out.submissions[0].call.function, "command");
      EXPECT_TRUE(call.ParseFromString(out.submissions[0].call.args.at(0)));
    }
    return call;
  }
  static std::vector<std::string> drones_in(const CommandCall& call) {
    std::vector<std::string> names;
    for (const auto& plan : call.plans()) names.push_back(plan.drone());
    return names;
  }

  FlightCore core;
  TimeNs now_ns = ns_per_s;
  std::uint64_t sequence = 0;
};

TEST_F(FlightByHand, PlansOfAllDronesOfABlockGoInOneCall) {
  const auto out = states({1, 2, 3});
  EXPECT_THAT(drones_in(call_of(out)), testing::ElementsAre("tello1", "tello2", "tello3"));
  EXPECT_EQ(call_of(out).plans(0).action(), TAKEOFF);
}

TEST_F(FlightByHand, APlanCarriesTheBootIdStampAndEpochOfWhatItAnswers) {
  const auto call = call_of(states({1}));
  EXPECT_EQ(call.plans(0).boot_id(), 9u);
  EXPECT_EQ(call.plans(0).state_stamp_ns(), now_ns);
  EXPECT_EQ(call.plans(0).epoch(), 1u);
  EXPECT_EQ(call.plans(0).sequence(), 1u);
}

TEST_F(FlightByHand, OneCallIsInFlightUntilItIsCommittedAndNewerPlansReplaceThoseThatWait) {
  const auto first = states({1});
  EXPECT_TRUE(states({1}).submissions.empty());
  EXPECT_TRUE(states({1, 2}).submissions.empty());
  const TimeNs newest_ns = now_ns;
  const auto next = call_of(outcome(first.submissions[0].id, Kind::committed));
  EXPECT_THAT(drones_in(next), testing::ElementsAre("tello1", "tello2"));
  EXPECT_EQ(next.plans(0).state_stamp_ns(), newest_ns);
  EXPECT_EQ(next.plans(0).sequence(), 2u) << "a plan that was never sent uses up no number";
  EXPECT_EQ(core.status(0).commands.made, 3u);
  EXPECT_EQ(core.status(0).commands.sent, 2u);
  EXPECT_EQ(core.status(0).commands.merged, 1u);
}

TEST_F(FlightByHand, ItsOwnCommandInABlockFreesTheWayBeforeTheOutcomeComes) {
  const auto first = states({1});
  EXPECT_TRUE(states({1}).submissions.empty());
  const auto next = block(event("command", first.submissions[0].call.args[0]));
  EXPECT_EQ(next.submissions.size(), 1u);
}

TEST_F(FlightByHand, ACallThatHangsDoesNotHoldBackTheNextForLong) {
  (void)states({1});
  now_ns += 101 * ns_per_ms;
  EXPECT_EQ(states({1}).submissions.size(), 1u);
}

TEST_F(FlightByHand, ACallRefusedForOneDroneIsSentAgainAtOnceWithoutIt) {
  const auto first = states({1, 2, 3});
  const auto sent = call_of(first);
  const auto again = call_of(
      outcome(first.submissions[0].id, Kind::refused, "chaincode response 500, tello2: stopped by Org1MSP CN=x"));
  EXPECT_THAT(drones_in(again), testing::ElementsAre("tello1", "tello3"));
  EXPECT_EQ(again.plans(0).SerializeAsString(), sent.plans(0).SerializeAsString());
  EXPECT_EQ(core.status(1).commands.refused, 1u);
  EXPECT_EQ(core.status(0).commands.refused, 0u);
  EXPECT_EQ(core.status(0).commands.sent, 1u) << "sent again is not sent twice";
  EXPECT_EQ(core.transactions().refused, 1u);
}

TEST_F(FlightByHand, AnOutsidersNameInARefusalIsNoDrones) {
  const auto first = states({1, 2});
  const auto again = outcome(first.submissions[0].id, Kind::refused,
                             "chaincode response 500, tello1: the lease is held by Org2MSP CN=a tello2: b");
  EXPECT_THAT(drones_in(call_of(again)), testing::ElementsAre("tello2"));
  EXPECT_EQ(core.status(0).commands.refused, 1u);
  EXPECT_EQ(core.status(1).commands.refused, 0u);
}

TEST_F(FlightByHand, ARefusalOfTello1IsNotOneOfTello11) {
  const auto first = states({1, 2});
  const auto again = outcome(first.submissions[0].id, Kind::refused, "chaincode response 500, tello11: not the holder");
  EXPECT_TRUE(again.submissions.empty());
}

TEST_F(FlightByHand, AfterAnInvalidatedCallTheNextPlanGoesOut) {
  const auto first = states({1});
  EXPECT_TRUE(outcome(first.submissions[0].id, Kind::invalidated).submissions.empty());
  EXPECT_EQ(states({1}).submissions.size(), 1u);
  EXPECT_EQ(core.transactions().invalidated, 1u);
}

TEST_F(FlightByHand, AStateSeenBeforeMakesNoSecondPlan) {
  SetCall call;
  StateSample sample;
  sample.phase = LinkPhase::on_ground;
  sample.sequence = 5;
  sample.stamp_ns = sample.pose_stamp_ns = now_ns;
  add_state(call, "tello1", sample);
  EXPECT_EQ(block(event("set", call.SerializeAsString())).submissions.size(), 1u);
  now_ns += ns_per_s;
  EXPECT_TRUE(block(event("set", call.SerializeAsString())).submissions.empty());
  EXPECT_EQ(core.status(0).states_received, 1u);
}

TEST_F(FlightByHand, WhatRidesAgainInABatchIsNoNewsButTransitionsAlwaysAre) {
  StateSample sample;
  sample.boot_id = 9;
  sample.sequence = 5;
  sample.stamp_ns = sample.pose_stamp_ns = now_ns;
  SetCall call;
  Asset* battery = call.add_assets();
  battery->set_id("tello2/battery");
  battery->set_msg_type(std::string(battery_type));
  battery->set_msg_data(to_cdr(BatteryState{{5, "tello2/base_link"}, 0, 0.5F}));
  add_state(call, "tello2", sample);
  const auto first = block(event("set", call.SerializeAsString()));
  ASSERT_EQ(first.updates.size(), 1U);
  EXPECT_EQ(first.updates[0].drone, 1U);
  EXPECT_EQ(first.updates[0].state->sequence, 5U);
  EXPECT_EQ(first.updates[0].odometry, call.assets(1).msg_data());
  EXPECT_EQ(first.updates[0].battery, call.assets(0).msg_data());
  EXPECT_EQ(first.updates[0].state->battery, 0.5F);
  EXPECT_TRUE(block(event("set", call.SerializeAsString())).updates.empty());

  Asset* failsafe = call.add_assets();
  failsafe->set_id("tello2/failsafe");
  failsafe->set_msg_type(std::string(transitions_type));
  failsafe->set_msg_data("transitions");
  const auto again = block(event("set", call.SerializeAsString()));
  ASSERT_EQ(again.updates.size(), 1U);
  EXPECT_EQ(again.updates[0].transitions, "transitions");
  EXPECT_TRUE(again.updates[0].odometry.empty());
  EXPECT_FALSE(again.updates[0].state);
}

TEST_F(FlightByHand, AnAlarmOfADronesAgentIsPublishedReportedAndCounted) {
  const auto reported = [&](bool stands) {
    SetCall call;
    Asset* asset = call.add_assets();
    asset->set_id("tello2/alarm");
    asset->set_msg_type(std::string(alarms_type));
    asset->set_msg_data(alarms_to_cdr({}, "tello2", {{"chain_broken", stands, 3, "block 9 came where 8 was due", 9}}));
    return block(event("set", call.SerializeAsString()));
  };
  const auto begins = reported(true);
  ASSERT_EQ(begins.updates.size(), 1U);
  EXPECT_FALSE(begins.updates[0].alarm.empty());
  EXPECT_THAT(begins.notes,
              testing::ElementsAre("tello2: its agent does not trust the ledger: chain_broken (3 times): block 9 "
                                   "came where 8 was due"));
  EXPECT_TRUE(core.status(1).ledger_untrusted);
  EXPECT_FALSE(core.status(0).ledger_untrusted);
  EXPECT_THAT(reported(false).notes, testing::ElementsAre("tello2: its agent trusts the ledger again"));
  EXPECT_FALSE(core.status(1).ledger_untrusted);
  EXPECT_EQ(core.status(1).alarms, 2U);
}

TEST_F(FlightByHand, InvalidTransactionsAndForeignAssetsAreNotListenedTo) {
  fabric::Transaction invalid = event("set", "");
  StateSample sample;
  sample.phase = LinkPhase::on_ground;
  sample.sequence = 5;
  sample.pose_stamp_ns = now_ns;
  SetCall call;
  add_state(call, "tello1", sample);
  invalid.event_payload = call.SerializeAsString();
  invalid.args = {invalid.event_payload};
  invalid.code = 11;
  EXPECT_TRUE(block(invalid).traces.empty());
  SetCall foreign;
  add_state(foreign, "tello99", sample);
  EXPECT_TRUE(block(event("set", foreign.SerializeAsString())).traces.empty());
  EXPECT_TRUE(block(event("set", "\xff\xff garbage")).traces.empty());
}

TEST_F(FlightByHand, ANewLeaseRestartsTheSequence) {
  const auto first = states({1});
  (void)outcome(first.submissions[0].id, Kind::committed);
  Controls controls;
  *controls.add_controls() = control_record("tello1", operator_name, 2);
  (void)block(control_event("acquire", {"tello1"}, controls.SerializeAsString()));
  const auto call = call_of(states({1}));
  EXPECT_EQ(call.plans(0).epoch(), 2u);
  EXPECT_EQ(call.plans(0).sequence(), 1u);
}

TEST_F(FlightByHand, AStartUnderARunningLeaseGoesOnBehindWhatWasFlown) {
  EXPECT_GE(call_of(states({1}, 41)).plans(0).sequence(), 541u) << "plans that were in flight have numbers, too";
}

TEST_F(FlightByHand, AStopEndsTheFlightOfThatDroneAndItIsCommandedNoMore) {
  const auto first = states({1, 2});
  (void)outcome(first.submissions[0].id, Kind::committed);
  Stops stops;
  *stops.add_stops() = stop_of("tello1", {"Org1MSP", "CN=Supervisor"});
  (void)block(control_event("stop", {"tello1"}, stops.SerializeAsString()));
  EXPECT_EQ(core.status(0).phase, GroundPhase::landing);
  EXPECT_THAT(core.why(), HasSubstr("tello1: stopped by Org1MSP CN=Supervisor"));
  EXPECT_THAT(drones_in(call_of(states({1, 2}))), testing::ElementsAre("tello2"));
}

TEST_F(FlightByHand, AStopAsJsonCountsToo) {
  const auto first = states({1});
  (void)outcome(first.submissions[0].id, Kind::committed);
  (void)block(control_event("stop", {"tello1"},
                            R"({"stops":[{"drone":"tello1","stopper":{"mspId":"Org3MSP","subject":"CN=Somebody"}}]})"));
  EXPECT_THAT(core.why(), HasSubstr("stopped by Org3MSP CN=Somebody"));
}

TEST_F(FlightByHand, ALostLeaseIsAFailure) {
  (void)states({1});
  Controls controls;
  *controls.add_controls() = control_record("tello1", outsider_name, 2);
  (void)block(control_event("acquire", {"tello1"}, controls.SerializeAsString()));
  EXPECT_EQ(core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(core.why(), HasSubstr("lost its lease to CN=User1@org3"));
}

TEST_F(FlightByHand, AnOlderRecordDoesNotUndoANewerOne) {
  Controls controls;
  *controls.add_controls() = control_record("tello1", outsider_name, 0);
  (void)block(control_event("acquire", {"tello1"}, controls.SerializeAsString()));
  EXPECT_EQ(states({1}).submissions.size(), 1u);
}

TEST_F(FlightByHand, TheDelayIsTheWayOfItsOwnCommandsThereAndBack) {
  for (int i = 0; i < 30; ++i) {
    const auto out = states({1});
    now_ns += 40 * ns_per_ms;
    (void)block(event("command", out.submissions[0].call.args[0]));
    (void)outcome(out.submissions[0].id, Kind::committed);
  }
  EXPECT_NEAR(to_ms(core.delay_ns()), 80, 1);
}

/// The ledger takes 10 ms of ground's plans, but each is at the drone `far_ns` after it was made, as far as the newest
/// states say.
class FlightFarFromTheDrone : public FlightByHand {
 protected:
  FlightFarFromTheDrone() : FlightByHand(1) { (void)flying({1}, 1.0); }
  void exchange(int times, TimeNs far_ns, bool arrive = true) {
    for (int i = 0; i < times; ++i) {
      while (arrive && !under_way.empty() && under_way.front().second + far_ns <= now_ns) {
        newest = {under_way.front().first, under_way.front().second + far_ns};
        under_way.pop_front();
      }
      const auto out = flying({1}, 1.0, newest.first, newest.second);
      const CommandCall call = call_of(out);
      ASSERT_EQ(call.plans_size(), 1);
      if (call.plans(0).action() == FLY) ahead_ns = call.plans(0).setpoints(0).at_ns() - now_ns;
      under_way.emplace_back(call.plans(0).sequence(), now_ns);
      now_ns += ledger_ns;
      (void)block(event("command", out.submissions[0].call.args[0]));
      (void)outcome(out.submissions[0].id, Kind::committed);
      now_ns += rest_ns;
    }
  }
  TimeNs ledger_ns = 10 * ns_per_ms, rest_ns = 20 * ns_per_ms;
  std::deque<std::pair<std::uint64_t, TimeNs>> under_way;  ///< sequence, made
  std::pair<std::uint64_t, TimeNs> newest{};               ///< sequence, came
  TimeNs ahead_ns = 0;                                     ///< of the newest plan's first setpoint
};

TEST_F(FlightFarFromTheDrone, PlansAreForWhenTheStatesSayThatPlansCome) {
  exchange(60, 500 * ns_per_ms);
  EXPECT_NEAR(to_ms(core.delay_ns()), 500, 1);
  EXPECT_NEAR(to_ms(ahead_ns), 500, 1);
  // Again and again: what was asked for is no part of what is measured.
  exchange(300, 500 * ns_per_ms);
  EXPECT_NEAR(to_ms(core.delay_ns()), 500, 1);
  exchange(100, 200 * ns_per_ms);
  EXPECT_NEAR(to_ms(core.delay_ns()), 200, 1);
}

TEST_F(FlightFarFromTheDrone, WhereNoPlanComesAnyMoreTheyAreForSoonerAgain) {
  exchange(120, 1'500 * ns_per_ms);
  EXPECT_NEAR(to_ms(core.delay_ns()), 1'500, 1);
  exchange(45, 0, false);  // agent may refuse them for being for too late
  EXPECT_NEAR(to_ms(core.delay_ns()), 1'500, 1);
  exchange(30, 0, false);
  EXPECT_NEAR(to_ms(core.delay_ns()), 20, 1);
}

TEST_F(FlightFarFromTheDrone, AtTwoHundredStatesASecondAPlanThatDoesNotComeIsMissedJustTheSame) {
  ledger_ns = rest_ns = 0;
  exchange(600, 1'500 * ns_per_ms);
  EXPECT_NEAR(to_ms(core.delay_ns()), 1'500, 1);
  exchange(390, 0, false);
  EXPECT_NEAR(to_ms(core.delay_ns()), 1'500, 1);
  exchange(20, 0, false);
  EXPECT_NEAR(to_ms(core.delay_ns()), 10, 1);
}

TEST_F(FlightFarFromTheDrone, PlanTimingIsLearnedAgainUnderANewLease) {
  exchange(60, 500 * ns_per_ms);
  EXPECT_NEAR(to_ms(core.delay_ns()), 500, 1);
  new_lease_of_tello1();
  EXPECT_NEAR(to_ms(core.delay_ns()), 20, 1);
  exchange(10, 500 * ns_per_ms);  // what comes is the earlier lease's
  EXPECT_NEAR(to_ms(core.delay_ns()), 20, 1);
  exchange(20, 200 * ns_per_ms);
  EXPECT_NEAR(to_ms(core.delay_ns()), 200, 1);
}

TEST_F(FlightFarFromTheDrone, AStateThatKnowsOfNoPlanSaysNothingOfWhenPlansCome) {
  const TimeNs before_ns = core.delay_ns();
  for (int i = 0; i < 10; ++i) {
    (void)flying({1}, 1.0, 999'999, now_ns);
    (void)flying({1}, 1.0, 0, now_ns);
  }
  EXPECT_EQ(core.delay_ns(), before_ns);
}

TEST_F(FlightByHand, APlanThatTakesTheNumberOfAnOlderOneHasItsOwnTime) {
  const auto commit = [&](const FlightOutputs& out) { (void)outcome(out.submissions.at(0).id, Kind::committed); };
  (void)flying({1, 2}, 1.0);
  for (int i = 0; i < 10; ++i) {
    const auto first = flying({1, 2}, 1.0);
    now_ns += 100 * ns_per_ms;
    (void)outcome(first.submissions.at(0).id, Kind::refused, "chaincode response 500, tello2: not the holder", true);
    const auto newer = flying({1}, 1.0);
    const std::uint64_t number = call_of(newer).plans(0).sequence();
    ASSERT_EQ(number, call_of(first).plans(0).sequence());
    commit(newer);
    const TimeNs came_ns = now_ns + 50 * ns_per_ms;
    now_ns = came_ns;
    commit(flying({1}, 1.0, number, came_ns));
  }
  EXPECT_NEAR(to_ms(core.delay_ns()), 50, 1);
}

// Agent takes no setpoint for later than 2 s from when it comes, and the quickest plan comes first.
TEST_F(FlightByHand, AfterAnOutageNoPlanSpeaksOfMoreThanTwoSecondsBehindItsArrival) {
  constexpr TimeNs quick_ns = 40 * ns_per_ms;
  (void)flying({1}, 1.0);
  for (const TimeNs long_ns : {600 * ns_per_ms, 700 * ns_per_ms}) {
    for (int i = 0; i < 90; ++i) {
      const auto out = flying({1}, 1.0);
      const auto call = call_of(out);
      ASSERT_EQ(call.plans_size(), 1);
      const auto& plan = call.plans(0);
      ASSERT_EQ(plan.action(), FLY);
      const TimeNs last_ns = plan.setpoints(plan.setpoints_size() - 1).at_ns();
      EXPECT_LE(last_ns, plan.state_stamp_ns() + 2 * quick_ns + 2 * ns_per_s) << to_ms(long_ns) << ", plan " << i;
      now_ns += i >= 30 && i < 68 ? long_ns : quick_ns;
      (void)block(event("command", out.submissions[0].call.args[0]));
      (void)outcome(out.submissions[0].id, Kind::committed);
    }
    // Its margin is used: the outage made plans later than the quick way alone would.
    EXPECT_GT(core.delay_ns(), 2 * quick_ns + 500 * ns_per_ms);
  }
}

TEST_F(FlightByHand, APlanThatWaitsIsForgottenWithItsLease) {
  (void)flying({1}, 0);
  EXPECT_EQ(flying({1}, 0).submissions.size(), 1u);
  const TimeNs first_ns = now_ns;
  while (now_ns < first_ns + 90 * ns_per_ms) EXPECT_TRUE(flying({1}, 0).submissions.empty());
  // The plan on its way ends 0.6 s behind its beginning, the one that waits 90 ms later.
  const TimeNs end_ns = now_ns + 610 * ns_per_ms;
  EXPECT_GT(sent_mps(end_ns), 0.45);
  new_lease_of_tello1();
  EXPECT_LT(sent_mps(end_ns), 0.3);
}

TEST_F(FlightByHand, APlanOfAnEarlierLeaseThatWouldBeSentAgainIsForgotten) {
  (void)flying({1, 2}, 0);
  new_lease_of_tello1();
  const auto earlier = flying({1, 2}, 0);
  Controls controls;
  *controls.add_controls() = control_record("tello1", operator_name, 3);
  (void)block(control_event("acquire", {"tello1"}, controls.SerializeAsString()));
  now_ns += 101 * ns_per_ms;
  const auto later = call_of(flying({1}, 0));
  EXPECT_EQ(later.plans(0).epoch(), 3u);
  const TimeNs before_ns = later.plans(0).setpoints(0).at_ns() - ns_per_ms;
  EXPECT_GT(sent_mps(before_ns), 0.03);  // by the earlier plan
  (void)outcome(earlier.submissions[0].id, Kind::refused, "chaincode response 500, tello2: not the holder");
  EXPECT_EQ(sent_mps(before_ns), 0);
}

TEST_F(FlightByHand, TracesSayWhenStatesCameAndPlansWereMade) {
  const auto out = states({2});
  ASSERT_EQ(out.traces.size(), 3u);
  EXPECT_EQ(out.traces[0].kind, TraceKind::state_received);
  EXPECT_EQ(out.traces[0].drone, 2);
  EXPECT_EQ(out.traces[0].stamp_ns, now_ns);
  EXPECT_EQ(out.traces[1].kind, TraceKind::command_made);
  EXPECT_EQ(out.traces[1].id, 1u);
  EXPECT_EQ(out.traces[2].kind, TraceKind::command_submitted);
  EXPECT_EQ(out.traces[2].stamp_ns, now_ns);
  EXPECT_EQ(out.traces[2].extra, out.submissions[0].id);
}

TEST_F(FlightByHand, TracesSayWhenItsCallWasEndorsedAndOrdered) {
  const auto sent = states({1});
  fabric::Outcome committed;
  committed.kind = Kind::committed;
  committed.endorsed_ns = now_ns + 1;
  committed.ordered_ns = now_ns + 2;
  FlightInputs inputs;
  inputs.outcome = &committed;
  inputs.outcome_id = sent.submissions[0].id;
  const auto out = core.step(now_ns + 3, inputs);
  ASSERT_EQ(out.traces.size(), 2u);
  EXPECT_EQ(out.traces[0].kind, TraceKind::call_endorsed);
  EXPECT_EQ(out.traces[0].t_ns, now_ns + 1);
  EXPECT_EQ(out.traces[1].kind, TraceKind::call_ordered);
  EXPECT_EQ(out.traces[1].t_ns, now_ns + 2);
  EXPECT_EQ(out.traces[1].id, sent.submissions[0].id);
}

TEST(FlightWithAFaultyLedger, WhatIsNoBatchOrNoStateIsCounted) {
  FlightCore core(config_for(1));
  StateSample sample;
  sample.sequence = 1;
  SetCall good, cut;
  add_state(good, "tello1", sample);
  add_state(cut, "tello1", sample);
  std::string& cdr = *cut.mutable_assets(0)->mutable_msg_data();
  cdr.resize(cdr.size() / 2);
  const std::string batch = good.SerializeAsString();
  for (const std::string& payload : {batch.substr(0, batch.size() / 2), cut.SerializeAsString(), batch}) {
    fabric::Block block;
    block.transactions.push_back(event("set", payload));
    FlightInputs inputs;
    inputs.block = &block;
    (void)core.step(ns_per_s, inputs);
  }
  EXPECT_EQ(core.transactions().malformed, 2u);
  EXPECT_EQ(core.status(0).states_received, 1u);
}

TEST(FlightWithAFaultyLedger, CountersAddUp) {
  FlightWorld world(config_for(2));
  world.run(120);
  ASSERT_TRUE(world.core.ok()) << world.core.why();
  for (std::size_t i = 0; i < 2; ++i) {
    const FlightStatus s = world.core.status(i);
    EXPECT_EQ(s.commands.made, s.commands.sent + s.commands.merged);
    EXPECT_EQ(s.commands.sent, world.drones[i].plans.size());
    for (std::size_t k = 0; k < world.drones[i].plans.size(); ++k)
      EXPECT_EQ(world.drones[i].plans[k].sequence(), k + 1);
  }
  EXPECT_EQ(world.core.transactions().submitted, world.calls.size());
  EXPECT_EQ(world.updates, world.core.status(0).states_received + world.core.status(1).states_received);
}

TEST(FlightWithAFaultyLedger, PlansStayWithinTheContractsLimitsWhenItIsVerySlow) {
  FlightWorld world(config_for(1));
  world.one_way_ns = 900 * ns_per_ms;
  world.run(60);
  for (const auto& plan : world.drones[0].plans) {
    EXPECT_LE(plan.setpoints_size(), 40);
    if (!plan.setpoints().empty()) {
      EXPECT_LE(plan.setpoints().rbegin()->at_ns() - plan.setpoints(0).at_ns(), 2 * ns_per_s);
    }
  }
  EXPECT_FALSE(world.drones[0].plans.empty());
}

}  // namespace
}  // namespace ledgerline::ground
