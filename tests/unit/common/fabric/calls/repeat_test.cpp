#include "common/fabric/calls/repeat.hpp"

#include <gtest/gtest.h>

namespace ledgerline::fabric {
namespace {

using Kind = Outcome::Kind;
using Next = Repeat::Next;

constexpr TimeNs start = 50 * ns_per_s;

Outcome ended(Kind kind, std::string message = {}, int code = 0) {
  Outcome outcome = Outcome::failed(kind, std::move(message));
  outcome.code = code;
  return outcome;
}

TEST(Repeat, EndsOnTheLedgerOrWithTheContractsRefusal) {
  EXPECT_EQ(Repeat({}, 1, start).ended(start, ended(Kind::committed)), Next::on_ledger);
  EXPECT_EQ(Repeat({}, 1, start).ended(start, ended(Kind::refused, "chaincode response 500, tello1: not stopped")),
            Next::refused);
}

TEST(Repeat, GoesOnBehindEverythingElse) {
  for (const Outcome& outcome : {ended(Kind::invalidated, "", 11), ended(Kind::unavailable, "no answer in time"),
                                 ended(Kind::overloaded), ended(Kind::refused, "the orderer: not ready"),
                                 ended(Kind::refused, "chaincode response 500, error in simulation: timeout expired"),
                                 ended(Kind::refused, "the peer's answer is not of this proposal")}) {
    EXPECT_EQ(Repeat({}, 1, start).ended(start, outcome), Next::again) << outcome.message;
  }
}

TEST(Repeat, ThePauseGrowsToItsMaximumAndHasJitter) {
  const RepeatLimits limits{.first_pause_ns = 10 * ns_per_ms, .max_pause_ns = 80 * ns_per_ms};
  Repeat one(limits, 1, start), other(limits, 2, start);
  TimeNs now = start;
  bool differ = false;
  for (const TimeNs max_ms : {10, 20, 40, 80, 80, 80}) {
    ASSERT_EQ(one.ended(now, ended(Kind::unavailable)), Next::again);
    ASSERT_EQ(other.ended(now, ended(Kind::unavailable)), Next::again);
    EXPECT_GE(one.at_ns() - now, max_ms * ns_per_ms / 2);
    EXPECT_LE(one.at_ns() - now, max_ms * ns_per_ms);
    differ = differ || one.at_ns() != other.at_ns();
    now += ns_per_s;
  }
  EXPECT_TRUE(differ) << "two that were stopped by one fault do not come back together";
  EXPECT_EQ(one.attempts(), 6);
}

TEST(Repeat, ItIsGivenUpWhenItsTimeIsUp) {
  Repeat repeat({.within_ns = 2 * ns_per_s}, 3, start);
  TimeNs now = start;
  int attempts = 0;
  while (repeat.ended(now, ended(Kind::unavailable)) == Next::again) {
    now = repeat.at_ns();
    ASSERT_LT(now, start + 2 * ns_per_s);
    ASSERT_LT(++attempts, 100);
  }
  EXPECT_GT(now, start + ns_per_s);
}

TEST(Repeat, OneOfConflictsAloneGivesUpOverAnythingElse) {
  const RepeatLimits limits{.attempts = 3, .conflicts_only = true};
  EXPECT_EQ(Repeat(limits, 1, start).ended(start, ended(Kind::unavailable)), Next::given_up);
  EXPECT_EQ(Repeat(limits, 1, start).ended(start, ended(Kind::invalidated, "", 4)), Next::given_up);
  Repeat repeat(limits, 1, start);
  EXPECT_EQ(repeat.ended(start, ended(Kind::invalidated, "", 11)), Next::again);
  EXPECT_EQ(repeat.ended(start, ended(Kind::invalidated, "", 12)), Next::again);
  EXPECT_EQ(repeat.ended(start, ended(Kind::invalidated, "", 12)), Next::given_up) << "the third";
}

}  // namespace
}  // namespace ledgerline::fabric
