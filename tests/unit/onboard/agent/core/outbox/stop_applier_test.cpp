#include "onboard/agent/core/outbox/control_calls.hpp"

#include <gtest/gtest.h>

#include "ledgerline.pb.h"

namespace ledgerline::agent {
namespace {

using Kind = fabric::Outcome::Kind;

constexpr TimeNs t0 = 100 * ns_per_s;

class StopApplierTest : public ::testing::Test {
 protected:
  static fabric::Outcome outcome(Kind kind, std::string message = {}) {
    fabric::Outcome o = fabric::Outcome::failed(kind, std::move(message));
    o.code = kind == Kind::invalidated ? 12 : 0;
    return o;
  }
  /// The next call's number after `now`; 0: none.
  std::uint64_t call(TimeNs now) {
    const auto sending = applier_.next(now);
    return sending ? sending->number : 0;
  }

  const std::vector<DroneName> drones_{{1, "tello1"}, {2, "tello2"}};
  StopApplier applier_{BackOffLimits{}, drones_, 7};
};

TEST_F(StopApplierTest, AStopIsAppliedOnceAtOnce) {
  EXPECT_EQ(call(t0), 0U);
  applier_.request(t0, 2);
  const auto sending = applier_.next(t0);
  ASSERT_TRUE(sending);
  const fabric::Call made = encode_apply_stops(*sending);
  EXPECT_EQ(made.function, "apply_stops");
  DronesCall message;
  ASSERT_TRUE(message.ParseFromString(made.args.at(0)));
  ASSERT_EQ(message.drones_size(), 1);
  EXPECT_EQ(message.drones(0), "tello2");
  EXPECT_EQ(call(t0 + ns_per_s), 0U) << "one at a time";
  EXPECT_TRUE(applier_.pending());
  EXPECT_TRUE(applier_.finished(t0, sending->number, outcome(Kind::committed)));
  EXPECT_FALSE(applier_.pending());
  EXPECT_EQ(call(t0 + ns_per_s), 0U);
  EXPECT_EQ(applier_.applied(), 1U);
}

TEST_F(StopApplierTest, WhateverElseBecomesOfItIsFollowedByAnotherBehindAGrowingPause) {
  applier_.request(t0, 1);
  TimeNs now = t0, last = t0;
  int calls = 0;
  for (const Kind kind : {Kind::invalidated, Kind::unavailable, Kind::overloaded, Kind::refused, Kind::invalidated}) {
    std::uint64_t number = 0;
    for (; (number = call(now)) == 0; now += ns_per_ms) ASSERT_LT(now, last + 10 * ns_per_s);
    if (calls++ > 0) {
      EXPECT_GT(now, last) << "not at once";
    }
    last = now;
    EXPECT_TRUE(applier_.finished(now, number, outcome(kind, "ledger at 127.0.0.1:1: away")));
  }
  EXPECT_TRUE(applier_.pending());
  EXPECT_EQ(applier_.repeated(), 5U);
}

TEST_F(StopApplierTest, TheContractsRefusalEndsIt) {
  applier_.request(t0, 1);
  const auto number = call(t0);
  applier_.finished(t0, number, outcome(Kind::refused, "chaincode response 500, tello1: enrolled to another"));
  EXPECT_FALSE(applier_.pending());
  EXPECT_EQ(applier_.applied(), 0U);
}

TEST_F(StopApplierTest, AStopThatComesDuringACallIsAppliedAfterIt) {
  applier_.request(t0, 1);
  const auto first = call(t0);
  applier_.request(t0, 1);
  applier_.finished(t0, first, outcome(Kind::committed));
  EXPECT_NE(call(t0), 0U) << "the first may have come before that stop";
}

TEST_F(StopApplierTest, WhileBatchesLackEndorsementsRecordsAreRenewedAtABoundedRate) {
  std::vector<TimeNs> renewals;
  const auto lacking = [&](TimeNs from, TimeNs until) {
    renewals.clear();
    for (TimeNs now = from; now < until; now += 30 * ns_per_ms) {
      applier_.request_renewal(now);
      while (const auto sending = applier_.next(now)) {
        if (sending->drone->number == 1) renewals.push_back(now);
        applier_.finished(now, sending->number, outcome(Kind::committed));
      }
    }
  };
  lacking(t0, t0 + 60 * ns_per_s);
  ASSERT_FALSE(renewals.empty());
  EXPECT_EQ(renewals.front(), t0) << "the first at once: the drones hold until then";
  EXPECT_GE(renewals.size(), 55U) << "the last of them a second behind the one before at most";
  EXPECT_LE(renewals.size(), 125U) << "0.2, 0.4, 0.8, 1 s, half of it at least";
  for (std::size_t i = 1; i < renewals.size(); ++i) EXPECT_GE(renewals[i] - renewals[i - 1], ns_per_s / 10);

  applier_.on_renewed();
  const TimeNs later = t0 + 700 * ns_per_s;
  lacking(later, later + 3 * ns_per_s);
  EXPECT_EQ(renewals.front(), later);
  EXPECT_GE(renewals.size(), 2U) << "the pause is short again";
}

TEST_F(StopApplierTest, EachDronesStopsAreAppliedByACallOfTheirOwn) {
  applier_.request(t0, 1);
  applier_.request(t0, 2);
  const auto one = call(t0), two = call(t0);
  EXPECT_NE(one, 0U);
  EXPECT_NE(two, 0U);
  applier_.finished(t0, one, outcome(Kind::invalidated));
  applier_.finished(t0, two, outcome(Kind::committed));
  EXPECT_TRUE(applier_.pending());
  EXPECT_EQ(applier_.applied(), 1U);
}

TEST_F(StopApplierTest, WhatIsNotOursIsLeftAlone) {
  applier_.request(t0, 9);
  EXPECT_EQ(call(t0), 0U);
  EXPECT_FALSE(applier_.finished(t0, 1, outcome(Kind::committed)));
  EXPECT_FALSE(applier_.finished(t0, 0, outcome(Kind::committed)));
}

}  // namespace
}  // namespace ledgerline::agent
