#include "common/rt/loop_ticker.hpp"

#include <gtest/gtest.h>

#include <ctime>

namespace ledgerline {
namespace {

constexpr TimeNs start = ns_per_s;

TEST(PackedTurns, SixteenTurnsFillARecord) {
  PackedTurns packed;
  for (int round = 0; round < 3; ++round) {
    for (std::size_t i = 0; i < PackedTurns::capacity; ++i) {
      const TimeNs due = start + (16 * round + static_cast<TimeNs>(i)) * ns_per_ms;
      const bool full = packed.add(due, due + static_cast<TimeNs>(i) * ns_per_us);
      ASSERT_EQ(full, i + 1 == PackedTurns::capacity);
    }
    const TraceRecord& record = packed.record();
    EXPECT_EQ(record.kind, TraceKind::loop_turns);
    EXPECT_EQ(record.id, 16U * static_cast<unsigned>(round));
    EXPECT_EQ(record.stamp_ns, start + 16 * round * ns_per_ms);
    EXPECT_EQ(record.t_ns, record.stamp_ns + 15 * ns_per_ms + 15 * ns_per_us);
    const auto late_us = PackedTurns::late_us(record);
    ASSERT_EQ(late_us.size(), 16U);
    for (std::size_t i = 0; i < 16; ++i) EXPECT_EQ(late_us[i], i);
  }
}

TEST(PackedTurns, WhatDoesNotFitIsShownAsTheLargest) {
  PackedTurns packed;
  (void)packed.add(start, start + ns_per_s);
  (void)packed.add(start, start - ns_per_s);
  EXPECT_EQ(PackedTurns::late_us(packed.record()), (std::vector<std::uint16_t>{65'535, 0}));
}

TEST(PackedTurns, ARecordThatIsNoneOfThemHasNoTurns) {
  TraceRecord record;
  record.kind = TraceKind::loop_turns;
  record.extra = 17;
  EXPECT_TRUE(PackedTurns::late_us(record).empty());
  record.extra = 3;
  EXPECT_EQ(PackedTurns::late_us(record).size(), 3U);
  record.kind = TraceKind::mode;
  EXPECT_TRUE(PackedTurns::late_us(record).empty());
}

TEST(LoopTicker, AreDueAPeriodApartAndNeverBeginEarly) {
  LoopTicker turns(ns_per_ms);
  TimeNs before = 0;
  for (int i = 0; i < 20; ++i) {
    const std::uint64_t overruns = turns.overruns();
    const TimeNs now = turns.wait();
    EXPECT_GE(now, turns.due_ns());
    const bool in_step = before != 0 && overruns == 0;  // an overrun moves the turns behind it
    EXPECT_TRUE(!in_step || turns.due_ns() == before + ns_per_ms);
    before = turns.due_ns();
  }
  EXPECT_EQ(turns.count(), 20U);
}

TEST(LoopTicker, MissedTurnsAreCountedOnceAndNotMadeUpFor) {
  LoopTicker turns(2 * ns_per_ms);
  (void)turns.wait();
  const timespec long_work{0, 20 * ns_per_ms};
  ::nanosleep(&long_work, nullptr);
  const std::uint64_t overruns = turns.overruns();
  const TimeNs after = turns.wait();
  EXPECT_EQ(turns.overruns(), overruns + 1);
  EXPECT_GE(turns.late().max(), 18 * ns_per_ms);
  (void)turns.wait();
  EXPECT_EQ(turns.due_ns(), after + 2 * ns_per_ms) << "not at once, to catch up";
}

}  // namespace
}  // namespace ledgerline
