#include "onboard/agent/core/outbox/integrity.hpp"

#include <gtest/gtest.h>

namespace ledgerline::agent::alarms {
namespace {

using Kind = fabric::Outcome::Kind;

constexpr TimeNs lasts = 10 * ns_per_s;
const std::vector<DroneName> two = {{1, "tello1"}, {2, "tello2"}};

fabric::Outcome ended(Kind kind) {
  fabric::Outcome o;
  o.kind = kind;
  return o;
}

class AlarmSenderTest : public ::testing::Test {
 protected:
  /// The drones that a call made now is of; empty: no call.
  std::size_t call(TimeNs now) {
    const auto sending = sender_.next(now, integrity_);
    number_ = sending ? sending->number : 0;
    return sending ? sending->drones.size() : 0;
  }
  void end(TimeNs now, Kind kind) { EXPECT_TRUE(sender_.finished(now, number_, ended(kind))); }
  void violate(TimeNs now) { integrity_.add(now, IntegrityViolation::stream, 0, "x"); }

  IntegrityMonitor integrity_{lasts};
  AlarmSender sender_{{}, two, 1};
  std::uint64_t number_ = 0;
};

TEST_F(AlarmSenderTest, BeginAndEndGoAtOnceAndBetweenThemAtMostOneAMinute) {
  EXPECT_EQ(call(0), 0U) << "the ledger is trusted";
  std::size_t calls = 0;
  for (TimeNs now = 0; now < 150 * ns_per_s; now += 100 * ns_per_ms) {
    violate(now);
    if (call(now) == 0) continue;
    EXPECT_EQ(now, static_cast<TimeNs>(calls) * AlarmSender::gap_ns);
    ++calls;
    end(now, Kind::committed);
  }
  EXPECT_EQ(calls, 3U);
  EXPECT_EQ(call(155 * ns_per_s), 0U);
  EXPECT_EQ(call(160 * ns_per_s), 2U) << "it is over";
  end(160 * ns_per_s, Kind::committed);
  EXPECT_EQ(call(1000 * ns_per_s), 0U);
}

TEST_F(AlarmSenderTest, OneCallIsInFlightAndWhatEndsOtherwiseIsMadeAgainBehindABackOff) {
  violate(0);
  TimeNs now = 0;
  for (const Kind kind : {Kind::invalidated, Kind::unavailable, Kind::overloaded}) {
    ASSERT_EQ(call(now), 2U);
    const auto first = number_;
    EXPECT_FALSE(sender_.next(now + 100 * ns_per_s, integrity_));
    number_ = first;
    end(now, kind);
    EXPECT_EQ(call(now), 0U) << "not at once";
    now += 2 * ns_per_s;
  }
  EXPECT_EQ(call(now), 2U);
  end(now, Kind::committed);
  EXPECT_EQ(sender_.counters().on_ledger, 1U);
  EXPECT_EQ(sender_.counters().repeated, 3U);
}

TEST_F(AlarmSenderTest, AViolationThatEndsBeforeTheLedgerIsBackIsStillReportedOnce) {
  violate(0);
  ASSERT_EQ(call(0), 2U);
  end(0, Kind::unavailable);
  EXPECT_EQ(call(3600 * ns_per_s), 2U);
  end(3600 * ns_per_s, Kind::committed);
  EXPECT_EQ(call(7200 * ns_per_s), 0U);
}

TEST_F(AlarmSenderTest, ADroneWhoseAlarmIsRefusedDoesNotSilenceTheOther) {
  violate(0);
  ASSERT_EQ(call(0), 2U);
  end(0, Kind::refused);
  ASSERT_EQ(call(2 * ns_per_s), 1U);
  end(2 * ns_per_s, Kind::refused);
  ASSERT_EQ(call(5 * ns_per_s), 1U) << "the other one's";
  end(5 * ns_per_s, Kind::committed);
  EXPECT_EQ(call(9 * ns_per_s), 0U) << "the refused one's waits";
  EXPECT_EQ(call(2 * ns_per_s + AlarmSender::gap_ns - 1), 1U) << "the other one's: it is over";
  end(2 * ns_per_s + AlarmSender::gap_ns - 1, Kind::committed);
  EXPECT_EQ(call(2 * ns_per_s + AlarmSender::gap_ns), 1U) << "and then tries again";
  EXPECT_FALSE(sender_.finished(0, 6, ended(Kind::committed))) << "none of ours";
}

}  // namespace
}  // namespace ledgerline::agent::alarms
