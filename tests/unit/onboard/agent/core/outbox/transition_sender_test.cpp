#include "onboard/agent/core/outbox/transition_sender.hpp"

#include <gtest/gtest.h>

#include "common/msg/ros.hpp"
#include "ledgerline.pb.h"
#include "onboard/agent/core/agent_core.hpp"

namespace ledgerline::agent {
namespace {

using Kind = fabric::Outcome::Kind;
using Numbers = std::vector<std::uint64_t>;

const std::vector<DroneName> two = {{1, "tello1"}, {2, "tello2"}};

Transition transition(std::uint64_t number, DroneNumber drone = 1, std::uint64_t oldest = 1, std::uint64_t boot = 9) {
  Transition t;
  t.drone = drone;
  t.boot_id = boot;
  t.number = number;
  t.oldest = oldest;
  t.stamp_ns = static_cast<TimeNs>(number) * ns_per_s;
  return t;
}

fabric::Outcome ended(Kind kind) {
  fabric::Outcome o;
  o.kind = kind;
  return o;
}

Numbers numbers(const std::optional<TransitionSender::Sending>& sending) {
  Numbers all;
  for (const Transition& t : sending.value().parts.at(0).transitions) all.push_back(t.number);
  return all;
}

TEST(TransitionSender, AllThatWaitGoInOrderInOneCallAndOneCallIsInFlight) {
  TransitionSender sender({}, two, 1);
  for (std::uint64_t n = 1; n <= 3; ++n) sender.add(transition(n));
  const auto first = sender.next(0);
  EXPECT_EQ(numbers(first), (Numbers{1, 2, 3}));
  sender.add(transition(4));
  EXPECT_FALSE(sender.next(ns_per_s));
  EXPECT_TRUE(sender.finished(ns_per_s, first->number, ended(Kind::committed)));
  EXPECT_EQ(numbers(sender.next(ns_per_s)), Numbers{4});
}

TEST(TransitionSender, WhateverACallEndsWithButCommittedItIsMadeAgainWithAllThatCame) {
  TransitionSender sender({}, two, 1);
  sender.add(transition(1));
  TimeNs now = 0;
  for (const Kind kind : {Kind::invalidated, Kind::refused, Kind::unavailable, Kind::overloaded}) {
    const auto sending = sender.next(now);
    ASSERT_TRUE(sending);
    EXPECT_EQ(sending->parts[0].transitions.front().number, 1U);
    EXPECT_TRUE(sender.finished(now, sending->number, ended(kind)));
    EXPECT_FALSE(sender.next(now)) << "not at once";
    now += 2 * ns_per_s;
  }
  sender.add(transition(2));
  const auto last = sender.next(now);
  EXPECT_EQ(numbers(last), (Numbers{1, 2}));
  sender.finished(now, last->number, ended(Kind::committed));
  EXPECT_FALSE(sender.pending());
  EXPECT_EQ(sender.counters(1).calls_repeated, 4U);
  EXPECT_EQ(sender.counters(1).on_ledger, 2U);
}

TEST(TransitionSender, AllThatWaitOfAllDronesGoInOneCall) {
  std::vector<DroneName> sixteen;
  for (DroneNumber k = 1; k <= 16; ++k) sixteen.push_back({k, "tello" + std::to_string(k)});
  TransitionSender sender({}, sixteen, 1);
  for (DroneNumber k = 1; k <= 16; ++k) sender.add(transition(1, k));
  const auto all = sender.next(0);
  ASSERT_TRUE(all);
  EXPECT_EQ(all->parts.size(), 16U);
  SetCall call;
  ASSERT_TRUE(call.ParseFromString(encode_transitions(*all, 0).args[0]));
  EXPECT_EQ(call.assets_size(), 16);
  EXPECT_EQ(call.assets(15).id(), "tello16/failsafe");
  EXPECT_TRUE(sender.finished(0, all->number, ended(Kind::committed)));
  EXPECT_FALSE(sender.pending());
}

TEST(TransitionSender, WhatComesWhileCallsAreInFlightWaitsForTheFirstThatEnds) {
  const std::vector<DroneName> four = {{1, "a"}, {2, "b"}, {3, "c"}, {4, "d"}};
  TransitionSender sender({}, four, 1);
  sender.add(transition(1, 1));
  const auto first = sender.next(0);
  sender.add(transition(1, 2));
  const auto second = sender.next(0);
  ASSERT_TRUE(first && second);
  sender.add(transition(1, 3));
  sender.add(transition(1, 4));
  EXPECT_FALSE(sender.next(0));
  sender.finished(0, first->number, ended(Kind::committed));
  EXPECT_EQ(sender.next(0).value().parts.size(), 2U);
}

TEST(TransitionSender, OneDronesRefusalDoesNotHoldUpAnother) {
  TransitionSender sender({}, two, 1);
  sender.add(transition(1, 1));
  sender.add(transition(1, 2));
  const auto both = sender.next(0);
  ASSERT_TRUE(both);
  sender.finished(0, both->number, ended(Kind::refused));
  const TimeNs later = 2 * ns_per_s;
  const auto first = sender.next(later), second = sender.next(later);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->parts.size() + second->parts.size(), 2U) << "each by itself from then on";
  EXPECT_EQ(second->parts[0].drone->name, "tello2");
  sender.finished(later, first->number, ended(Kind::refused));
  sender.finished(later, second->number, ended(Kind::committed));
  sender.add(transition(2, 2));
  EXPECT_EQ(numbers(sender.next(later)), Numbers{2});
}

TEST(TransitionSender, WhatCameBeforeOrCameTooSoonIsLeftToLinkToSendAgain) {
  TransitionSender sender({}, two, 1);
  sender.add(transition(1));
  sender.add(transition(1));
  sender.add(transition(3));
  AgentHeartbeat heartbeat;
  sender.report(heartbeat);
  EXPECT_EQ(heartbeat.boot_id, 9U);
  EXPECT_EQ(heartbeat.transitions_taken[1], 1U);
  EXPECT_EQ(heartbeat.transitions_on_ledger[1], 0U);
  sender.add(transition(2));
  sender.add(transition(3));
  EXPECT_EQ(numbers(sender.next(0)), (Numbers{1, 2, 3}));
}

TEST(TransitionSender, ARestartedAgentBeginsWithTheOldestThatLinkKeeps) {
  TransitionSender sender({}, two, 1);
  sender.add(transition(8, 1, 7));
  EXPECT_FALSE(sender.pending()) << "7 is missing";
  sender.add(transition(7, 1, 7));
  sender.add(transition(8, 1, 7));
  EXPECT_EQ(numbers(sender.next(0)), (Numbers{7, 8}));
}

TEST(TransitionSender, ARestartedLinkCountsFromOneAndTheOldOnesAreStillSent) {
  TransitionSender sender({}, two, 1);
  sender.add(transition(1));
  sender.add(transition(2));
  sender.add(transition(1, 1, 1, 10));
  AgentHeartbeat heartbeat;
  sender.report(heartbeat);
  EXPECT_EQ(heartbeat.boot_id, 10U);
  EXPECT_EQ(heartbeat.transitions_taken[1], 1U);
  const auto sending = sender.next(0);
  EXPECT_EQ(numbers(sending), (Numbers{1, 2, 1}));
  sender.finished(0, sending->number, ended(Kind::committed));
  sender.report(heartbeat);
  EXPECT_EQ(heartbeat.transitions_on_ledger[1], 1U);
}

TEST(TransitionSender, WhenItIsFullLinkKeepsTheRest) {
  TransitionSender sender({}, two, 1);
  for (std::uint64_t n = 1; n <= TransitionSender::max_kept + 5; ++n) sender.add(transition(n));
  AgentHeartbeat heartbeat;
  sender.report(heartbeat);
  EXPECT_EQ(heartbeat.transitions_taken[1], TransitionSender::max_kept);
  Numbers seen;
  while (const auto sending = sender.next(0)) {
    for (const std::uint64_t n : numbers(sending)) seen.push_back(n);
    EXPECT_LE(sending->parts[0].transitions.size(), TransitionSender::max_per_call);
    sender.finished(0, sending->number, ended(Kind::committed));
  }
  ASSERT_EQ(seen.size(), TransitionSender::max_kept);
  for (std::size_t i = 0; i < seen.size(); ++i) EXPECT_EQ(seen[i], i + 1);
}

TEST(TransitionSender, TheCallIsOneAssetWithEveryTransition) {
  TransitionSender sender({}, two, 1);
  Transition hold = transition(1);
  hold.phase = LinkPhase::flying;
  hold.mode = FailsafeMode::hold;
  hold.cause = FailsafeCause::ledger_silent;
  sender.add(hold);
  sender.add(transition(2));
  const auto call = encode_transitions(*sender.next(0), 1000 * ns_per_s);
  EXPECT_EQ(call.function, "set");
  EXPECT_FALSE(call.reported_by_block) << "its client has no block stream";
  SetCall set;
  ASSERT_TRUE(set.ParseFromString(call.args.at(0)));
  EXPECT_FALSE(set.stream()) << "a key of its own, not the batch that each state overwrites";
  ASSERT_EQ(set.assets_size(), 1);
  EXPECT_EQ(set.assets(0).id(), "tello1/failsafe");
  EXPECT_EQ(set.assets(0).msg_type(), "diagnostic_msgs/msg/DiagnosticArray");
  const auto read = transitions_from_cdr(set.assets(0).msg_data());
  ASSERT_TRUE(read);
  ASSERT_EQ(read->size(), 2U);
  EXPECT_EQ((*read)[0].mode, FailsafeMode::hold);
  EXPECT_EQ((*read)[0].cause, FailsafeCause::ledger_silent);
  EXPECT_EQ((*read)[0].phase, LinkPhase::flying);
  EXPECT_EQ((*read)[1].number, 2U);
}

TEST(AgentTransitions, GoAtOnceOnAWayOfTheirOwnWhateverBecomesOfTheStates) {
  const auto registry = crypto::make_test_registry({"Org1MSP"});
  AgentCoreSettings settings;
  settings.drones = two;
  AgentCore core(settings, *registry);
  AgentOutputs out;
  StateSample sample;
  sample.drone = 1;
  sample.sequence = 1;
  core.on_state(0, sample, out);
  core.step(0, out);
  ASSERT_EQ(out.submits.size(), 1U);
  core.on_outcome(0, out.submits[0].call_number, ended(Kind::unavailable), out);
  out.clear();
  sample.sequence = 2;
  core.on_state(1, sample, out);
  core.on_transition(transition(1));
  core.step(1, out);
  ASSERT_EQ(out.submits.size(), 1U) << "states are backing off";
  EXPECT_TRUE(out.submits[0].urgent);
  const auto call_number = out.submits[0].call_number;
  EXPECT_FALSE(core.ledger_alive(1));
  core.on_outcome(2, call_number, ended(Kind::committed), out);
  EXPECT_TRUE(core.ledger_alive(2)) << "that is a sign of life";
  EXPECT_EQ(core.report(1).transitions.on_ledger, 1U);
  out.clear();
  core.step(200 * ns_per_ms, out);  // its first heartbeat waits so long for poses
  ASSERT_TRUE(out.heartbeat);
  EXPECT_EQ(out.heartbeat->transitions_on_ledger[1], 1U);
}

TEST(AgentTransitions, AtAnOrderlyEndStillGoWhenStatesDoNot) {
  const auto registry = crypto::make_test_registry({"Org1MSP"});
  AgentCoreSettings settings;
  settings.drones = two;
  AgentCore core(settings, *registry);
  AgentOutputs out;
  core.stop_submitting();
  EXPECT_FALSE(core.has_calls_in_flight());
  core.on_transition(transition(1));
  EXPECT_TRUE(core.has_calls_in_flight());
  core.step(0, out);
  ASSERT_EQ(out.submits.size(), 1U);
  core.on_outcome(0, out.submits[0].call_number, ended(Kind::committed), out);
  EXPECT_FALSE(core.has_calls_in_flight());
}

}  // namespace
}  // namespace ledgerline::agent
