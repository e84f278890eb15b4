#include "onboard/link/core/drone_reporting.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "tests/unit/onboard/link/core/link_world.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

std::vector<std::uint64_t> sent(TransitionLog& log) {
  std::vector<std::uint64_t> numbers;
  for (Transition next; log.next(next);) numbers.push_back(next.number);
  return numbers;
}

using Numbers = std::vector<std::uint64_t>;

TEST(TransitionLog, EachIsSentOnceAndAgainWhenAgentSaysThatItHasNotTakenIt) {
  TransitionLog log;
  log.add({});
  log.add({});
  EXPECT_EQ(sent(log), (Numbers{1, 2}));
  EXPECT_EQ(sent(log), Numbers{});
  log.acknowledge(1, 0);
  EXPECT_EQ(sent(log), Numbers{2});
  log.acknowledge(2, 0);
  EXPECT_EQ(sent(log), Numbers{});
  EXPECT_EQ(log.counters().kept, 2U) << "agent has them, the ledger has not";
}

TEST(TransitionLog, WhatIsOnTheLedgerIsForgottenAndARestartedAgentGetsTheRest) {
  TransitionLog log;
  for (int i = 0; i < 5; ++i) log.add({});
  (void)sent(log);
  log.acknowledge(4, 3);
  EXPECT_EQ(sent(log), Numbers{5});
  log.acknowledge(0, 0);
  Transition next;
  ASSERT_TRUE(log.next(next));
  EXPECT_EQ(next.number, 4U);
  EXPECT_EQ(next.oldest, 4U) << "so that agent knows that nothing is missing before it";
  log.acknowledge(5, 5);
  EXPECT_EQ(log.counters().kept, 0U);
  EXPECT_EQ(log.counters().on_ledger, 5U);
}

TEST(TransitionLog, AtTheBoundTheOldestIsDroppedCountedAndReported) {
  TransitionLog log;
  for (std::uint64_t i = 0; i < TransitionLog::capacity + 3; ++i) log.add({});
  EXPECT_EQ(log.counters().lost, 3U);
  EXPECT_EQ(log.counters().kept, TransitionLog::capacity);
  Transition next;
  ASSERT_TRUE(log.next(next));
  EXPECT_EQ(next.number, 4U);
  EXPECT_EQ(next.oldest, 4U);
  EXPECT_EQ(next.lost, 3U);
}

TEST(TransitionLog, WhatAgentHasTakenIsNotLostAtTheBound) {
  TransitionLog log;
  log.add({});
  log.acknowledge(1, 0);
  for (std::uint64_t i = 0; i < TransitionLog::capacity; ++i) log.add({});
  EXPECT_EQ(log.counters().lost, 0U);
}

TEST(TransitionLog, WhatAgentCannotKnowIsNotTrusted) {
  TransitionLog log;
  log.add({});
  log.acknowledge(900, 900);
  EXPECT_EQ(log.counters().on_ledger, 1U);
  log.add({});
  EXPECT_EQ(sent(log), Numbers{2});
}

TEST(LinkCore, EveryChangeOfPhaseModeAndCauseIsATransitionOnce) {
  LinkWorld w;
  w.take_off();
  w.fly_plan({0, 0, 0}, 20);
  w.pass(500 * ms);
  w.ledger = false;
  w.pass(20 * ns_per_s);
  ASSERT_EQ(w.core.phase(1), LinkPhase::landed);
  std::vector<Transition> seen;
  for (const Transition& t : w.transitions) {
    if (seen.empty() || t.number > seen.back().number) seen.push_back(t);
  }
  struct Expected {
    LinkPhase phase;
    FailsafeMode mode;
    FailsafeCause cause;
  };
  using P = LinkPhase;
  using M = FailsafeMode;
  using C = FailsafeCause;
  const std::vector<Expected> expected{{P::on_ground, M::none, C::none},        {P::taking_off, M::none, C::none},
                                       {P::flying, M::none, C::none},           {P::flying, M::hold, C::ledger_silent},
                                       {P::landing, M::land, C::ledger_silent}, {P::landed, M::none, C::none}};
  ASSERT_EQ(seen.size(), expected.size());
  for (std::size_t i = 0; i < seen.size(); ++i) {
    EXPECT_EQ(seen[i].number, i + 1);
    EXPECT_EQ(seen[i].boot_id, 42U);
    EXPECT_EQ(seen[i].phase, expected[i].phase) << i;
    EXPECT_EQ(seen[i].mode, expected[i].mode) << i;
    EXPECT_EQ(seen[i].cause, expected[i].cause) << i;
    EXPECT_TRUE(i == 0 || seen[i].stamp_ns > seen[i - 1].stamp_ns);
  }
}

TEST(LinkCore, ATransitionIsSentUntilAHeartbeatSaysThatItIsTaken) {
  LinkWorld w;
  w.pass(ns_per_s);
  const auto repeats = w.transitions.size();
  EXPECT_GT(repeats, 5U) << "each heartbeat of an agent that has taken nothing asks again";
  w.heartbeat.boot_id = 42;
  w.heartbeat.transitions_taken[1] = 1;
  w.pass(100 * ms);
  w.transitions.clear();
  w.pass(ns_per_s);
  EXPECT_TRUE(w.transitions.empty());
  w.heartbeat.boot_id = 43;  // it says so of another start of link
  w.pass(100 * ms);
  EXPECT_FALSE(w.transitions.empty());
  EXPECT_EQ(w.core.reports()[0].transitions.kept, 1U);
  w.heartbeat.boot_id = 42;
  w.heartbeat.transitions_on_ledger[1] = 1;
  w.pass(100 * ms);
  EXPECT_EQ(w.core.reports()[0].transitions.kept, 0U);
}

TEST(LinkCore, AHeartbeatCountsForTheDronesOfItsChannelAlone) {
  LinkWorld w(2);
  w.take_off();
  w.heartbeat.drones = AgentHeartbeat::bit_of(1);  // drone 2 is on another channel, whose heartbeats end
  w.pass(2 * ns_per_s);                            // without plans both hold, each for its reason
  ASSERT_GE(w.states.size(), 2U);
  for (std::size_t i = w.states.size() - 2; i < w.states.size(); ++i) {
    const StateSample& state = w.states[i];
    ASSERT_EQ(state.phase, LinkPhase::flying) << state.drone;
    EXPECT_EQ(state.cause, state.drone == 1 ? FailsafeCause::plan_ran_out : FailsafeCause::agent_silent) << state.drone;
  }
}

}  // namespace
}  // namespace ledgerline::link
