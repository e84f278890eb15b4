#include "onboard/agent/core/outbox/control_calls.hpp"

#include <gtest/gtest.h>

#include "ledgerline.pb.h"

namespace ledgerline::agent::idle_holders {
namespace {

using Kind = fabric::Outcome::Kind;
using Next = fabric::Repeat::Next;

constexpr TimeNs t0 = 100 * ns_per_s;
constexpr TimeNs idle = 60 * ns_per_s;
constexpr IdleEvictor::View held_on_ground{.lease = 5, .on_ground = true, .ledger_alive = true};

class IdleEvictorTest : public ::testing::Test {
 protected:
  static fabric::Outcome outcome(Kind kind, std::string message = {}) {
    fabric::Outcome o = fabric::Outcome::failed(kind, std::move(message));
    o.code = kind == Kind::invalidated ? 11 : 0;
    return o;
  }
  /// It is so until then, looked at ten times a second; calls on the way.
  std::vector<std::uint64_t> until(TimeNs end, const IdleEvictor::View& view = held_on_ground) {
    std::vector<std::uint64_t> calls;
    for (; now_ < end; now_ += 100 * ns_per_ms) {
      evictor_.update(now_, 1, view);
      while (const auto sending = evictor_.next(now_)) calls.push_back(sending->number);
    }
    return calls;
  }
  std::uint64_t first_call() {
    const auto calls = until(now_ + idle + ns_per_s);
    EXPECT_EQ(calls.size(), 1U);
    return calls.empty() ? 0 : calls.front();
  }

  const std::vector<DroneName> drones_{{1, "tello1"}, {2, "tello2"}};
  IdleEvictor evictor_{idle, BackOffLimits{}, drones_, 7};
  TimeNs now_ = t0;
};

TEST_F(IdleEvictorTest, AHolderOnTheGroundWhoSaysNothingIsEvictedOnceAfterTheIdleTime) {
  EXPECT_TRUE(until(t0 + idle).empty()) << "an agent that has just started counts from its start";
  const auto calls = until(t0 + idle + 30 * ns_per_s);
  ASSERT_EQ(calls.size(), 1U) << "one call at a time";
  EXPECT_TRUE(evictor_.is_evicting(1));
  EXPECT_FALSE(evictor_.is_evicting(2));
  const fabric::Call made = encode_evict({calls[0], &drones_[0], 7});
  EXPECT_EQ(made.function, "evict");
  DronesCall message;
  ASSERT_TRUE(message.ParseFromString(made.args.at(0)));
  ASSERT_EQ(message.drones_size(), 1);
  EXPECT_EQ(message.drones(0), "tello1");
  EXPECT_EQ(message.epochs(0), 7U) << "the next holder keeps it";
  const auto ended = evictor_.finished(now_, calls[0], outcome(Kind::committed));
  ASSERT_TRUE(ended);
  EXPECT_EQ(ended->drone->name, "tello1");
  EXPECT_EQ(ended->next, Next::on_ledger);
  EXPECT_EQ(evictor_.counters().evicted, 1U);
  EXPECT_FALSE(evictor_.has_call_in_flight());
  EXPECT_TRUE(until(now_ + 10 * idle, {.lease = {}, .on_ground = true, .ledger_alive = true}).empty())
      << "nobody holds it";
}

TEST_F(IdleEvictorTest, ACommandOfTheHolderRestartsTheClock) {
  for (int i = 0; i < 10; ++i) {
    EXPECT_TRUE(until(now_ + idle - ns_per_s).empty());
    evictor_.on_command(now_, 1);
  }
  EXPECT_EQ(until(now_ + idle + ns_per_s).size(), 1U);
}

TEST_F(IdleEvictorTest, ANewLeaseRestartsTheClock) {
  EXPECT_TRUE(until(now_ + idle - ns_per_s).empty());
  EXPECT_TRUE(until(now_ + idle - ns_per_s, {.lease = 6, .on_ground = true, .ledger_alive = true}).empty());
}

TEST_F(IdleEvictorTest, NobodyIsEvictedInTheAirOrWithoutStateAndTheClockRestartsOnTheGround) {
  EXPECT_TRUE(until(t0 + 5 * idle, {.lease = 5, .on_ground = false, .ledger_alive = true}).empty());
  EXPECT_TRUE(until(now_ + idle - ns_per_s).empty());
  EXPECT_EQ(until(now_ + 2 * ns_per_s).size(), 1U);
}

TEST_F(IdleEvictorTest, WithZeroNobodyIsEverEvicted) {
  evictor_ = IdleEvictor(0, BackOffLimits{}, drones_, 7);
  EXPECT_TRUE(until(t0 + 100 * idle).empty());
}

TEST_F(IdleEvictorTest, WhileTheLedgerIsSilentNothingIsSentNorBeforeWhatItMissedMayHaveCome) {
  EXPECT_TRUE(until(t0 + 2 * idle, {.lease = 5, .on_ground = true, .ledger_alive = false}).empty());
  EXPECT_TRUE(until(now_ + IdleEvictor::catch_up_ns - ns_per_s).empty());
  EXPECT_EQ(until(now_ + 2 * ns_per_s).size(), 1U) << "it was idle all that time";
}

TEST_F(IdleEvictorTest, WhatDoesNotGetThroughIsSentAgainBehindPausesAndNotForEver) {
  std::uint64_t call = first_call();
  int calls = 1;
  std::optional<Next> next = Next::again;
  TimeNs last = now_;
  while (next == Next::again) {
    const auto ended = evictor_.finished(now_, call, outcome(calls % 2 == 0 ? Kind::invalidated : Kind::unavailable));
    ASSERT_TRUE(ended);
    next = ended->next;
    if (next != Next::again) break;
    const auto again = until(now_ + 3 * ns_per_s);
    ASSERT_EQ(again.size(), 1U);
    call = again[0];
    EXPECT_GT(now_, last);
    last = now_;
    ASSERT_LE(++calls, 20);
  }
  EXPECT_EQ(next, Next::given_up);
  EXPECT_GE(calls, 3);
  EXPECT_LE(calls, 10);
  EXPECT_EQ(evictor_.counters().given_up, 1U);
  EXPECT_TRUE(until(now_ + idle - ns_per_s).empty()) << "not before another idle time";
  EXPECT_EQ(until(now_ + 2 * ns_per_s).size(), 1U);
}

TEST_F(IdleEvictorTest, ARefusalIsNotTriedAgainBeforeAnotherIdleTime) {
  const auto call = first_call();  // takes its time
  const auto ended =
      evictor_.finished(now_, call, outcome(Kind::refused, "chaincode response 500, tello1: you may not evict"));
  ASSERT_TRUE(ended);
  EXPECT_EQ(ended->next, Next::refused);
  EXPECT_EQ(evictor_.counters().refused, 1U);
  EXPECT_TRUE(until(now_ + idle - ns_per_s).empty());
  EXPECT_EQ(until(now_ + 2 * ns_per_s).size(), 1U);
}

TEST_F(IdleEvictorTest, ItIsGivenUpWhenTheHolderCommandsTakesOffOrChanges) {
  for (int way = 0; way < 3; ++way) {
    const auto call = first_call();
    if (way == 0) evictor_.on_command(now_, 1);
    if (way == 1) evictor_.update(now_, 1, {.lease = 5, .on_ground = false, .ledger_alive = true});
    if (way == 2) evictor_.update(now_, 1, {.lease = 6, .on_ground = true, .ledger_alive = true});
    EXPECT_TRUE(evictor_.is_evicting(1)) << "what is in flight cannot be called back";
    const auto ended = evictor_.finished(now_, call, outcome(Kind::unavailable));
    ASSERT_TRUE(ended);
    EXPECT_FALSE(ended->next);
    EXPECT_TRUE(until(now_ + idle - ns_per_s).empty());
    evictor_.on_command(now_, 1);
  }
}

TEST_F(IdleEvictorTest, AnEvictionThatSucceededIsReportedThoughItWasNoLongerWanted) {
  const auto call = first_call();
  evictor_.on_command(now_, 1);
  const auto ended = evictor_.finished(now_, call, outcome(Kind::committed));
  ASSERT_TRUE(ended);
  EXPECT_EQ(ended->next, Next::on_ledger);
}

TEST_F(IdleEvictorTest, WhatIsNotOursIsLeftAlone) {
  evictor_.update(t0, 9, held_on_ground);
  evictor_.on_command(t0, 9);
  EXPECT_FALSE(evictor_.finished(t0, 1, outcome(Kind::committed)));
  EXPECT_FALSE(evictor_.finished(t0, 0, outcome(Kind::committed)));
}

}  // namespace
}  // namespace ledgerline::agent::idle_holders
