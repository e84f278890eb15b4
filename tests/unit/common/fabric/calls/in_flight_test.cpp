#include "common/fabric/calls/in_flight.hpp"

#include <gtest/gtest.h>

namespace ledgerline::fabric {
namespace {

using Kind = Outcome::Kind;

Outcome committed(TimeNs ordered_after_ns = 0) {
  Outcome outcome = Outcome::failed(Kind::committed, "");
  outcome.ordered_after_ns = ordered_after_ns;
  return outcome;
}

TEST(InFlight, AnotherGoesAtOnceWhileNoneIsInFlightElseAfterAGap) {
  InFlight<int> calls;
  EXPECT_TRUE(calls.may_go(0));
  calls.add(1, 0, 10);
  EXPECT_FALSE(calls.may_go(99 * ns_per_ms)) << "until something is known of the ledger";
  EXPECT_TRUE(calls.may_go(100 * ns_per_ms));
  calls.add(2, 100 * ns_per_ms, 20);
  EXPECT_FALSE(calls.may_go(199 * ns_per_ms)) << "behind the newest";
  const auto ended = calls.end(1, committed(5 * ns_per_ms));
  ASSERT_TRUE(ended);
  EXPECT_EQ(ended->what, 10);
  EXPECT_EQ(ended->submitted_ns, 0);
  EXPECT_TRUE(calls.may_go(120 * ns_per_ms)) << "four times what ordering took";
  EXPECT_FALSE(calls.may_go(119 * ns_per_ms));
}

TEST(InFlight, ACallEndsOnceAndOneThatIsNoneChangesNothing) {
  InFlight<int> calls;
  calls.add(7, 0, 1);
  EXPECT_FALSE(calls.end(8, committed(ns_per_s)));
  EXPECT_FALSE(calls.may_go(99 * ns_per_ms));
  EXPECT_TRUE(calls.end(7, committed()));
  EXPECT_FALSE(calls.end(7, committed()));
  EXPECT_TRUE(calls.empty());
  EXPECT_EQ(calls.last_ns(), 0);
}

TEST(InFlight, ItIsFullAtItsBoundWhateverIsInABlock) {
  InFlight<std::size_t> calls;
  for (std::size_t i = 0; i < InFlight<std::size_t>::max; ++i) {
    EXPECT_FALSE(calls.full());
    calls.add(i, 0, i);
    EXPECT_TRUE(calls.mark_in_block([&](std::size_t what) { return what == i; }));
  }
  EXPECT_TRUE(calls.full());
}

TEST(InFlight, WhatIsInABlockIsWaitedForNoMore) {
  InFlight<int> calls;
  calls.add(1, 0, 1);
  calls.add(2, 200 * ns_per_ms, 2);
  EXPECT_EQ(calls.mark_in_block([](int what) { return what == 2; }), 200 * ns_per_ms);
  EXPECT_FALSE(calls.mark_in_block([](int what) { return what == 2; })) << "once";
  EXPECT_TRUE(calls.may_go_behind_open(210 * ns_per_ms)) << "the first is long ago";
  EXPECT_FALSE(calls.may_go(210 * ns_per_ms));
  EXPECT_TRUE(calls.mark_in_block([](int) { return true; }));
  EXPECT_TRUE(calls.may_go(210 * ns_per_ms));
  const auto ended = calls.end(2, committed());
  ASSERT_TRUE(ended);
  EXPECT_TRUE(ended->in_block);
}

TEST(InFlight, WhileTheLedgerIsAwayLessAndLessIsAdded) {
  InFlight<int> calls;
  calls.add(1, 0, 1);
  calls.add(2, 8 * ns_per_s, 2);
  EXPECT_FALSE(calls.may_go(9 * ns_per_s)) << "an eighth of the oldest one's age";
  EXPECT_TRUE(calls.may_go(9'200 * ns_per_ms));
}

}  // namespace
}  // namespace ledgerline::fabric
