#include "onboard/agent/core/mocap.hpp"

#include <gtest/gtest.h>

namespace ledgerline::agent {
namespace {

constexpr TimeNs second = ns_per_s;

struct Clocks {
  TimeNs offset_ns = 1'000'000 * second;
  MocapClock clock{[this] { return offset_ns; }};
};

TEST(MocapClock, TurnsRealTimeIntoTheMonotonicClock) {
  Clocks c;
  EXPECT_EQ(c.clock.stamp(c.offset_ns + 5 * second, 5 * second + 3 * ns_per_ms), 5 * second);
}

TEST(MocapClock, AJumpOfRealTimeCostsNoPose) {
  for (const TimeNs jump : {-3600 * second, -2 * second, -1 * second, -100 * ns_per_ms, -1 * ns_per_ms, 1 * ns_per_ms,
                            20 * ns_per_ms, 30 * ns_per_ms, 60 * second}) {
    Clocks c;
    c.offset_ns += jump;
    EXPECT_EQ(c.clock.stamp(c.offset_ns + 5 * second, 5 * second + 3 * ns_per_ms), 5 * second) << jump;
  }
}

// A pose each 10 ms, on its way for 5 ms; real time jumps between.
TEST(MocapClock, WhateverTheJumpNoPoseIsNewerThanItsArrivalAndAllSentAfterItAreExact) {
  for (TimeNs jump = -1 * second; jump <= 20 * ns_per_ms; jump += ns_per_ms) {
    Clocks c;
    const TimeNs jump_at = 1003 * ns_per_ms;
    for (TimeNs sent = 900 * ns_per_ms; sent <= 1200 * ns_per_ms; sent += 10 * ns_per_ms) {
      const TimeNs said = c.offset_ns + sent, arrived = sent + 5 * ns_per_ms;
      if (sent <= jump_at && jump_at < arrived) c.offset_ns += jump;
      const auto stamp = c.clock.stamp(said, arrived);
      if (stamp) {
        EXPECT_LE(*stamp, arrived) << jump << " " << sent;
      }
      if (sent < 1000 * ns_per_ms || sent > jump_at) {
        EXPECT_EQ(stamp, sent) << jump << " " << sent;
      }
    }
  }
}

TEST(MocapClock, AStampOfTheFutureOrTheFarPastIsNotTrusted) {
  Clocks c;
  const TimeNs now = 100 * second;
  EXPECT_EQ(c.clock.stamp(c.offset_ns + now + 20 * ns_per_ms, now), now);
  EXPECT_FALSE(c.clock.stamp(c.offset_ns + now + 20 * ns_per_ms + 1, now));
  EXPECT_TRUE(c.clock.stamp(c.offset_ns + now - second, now));
  EXPECT_FALSE(c.clock.stamp(c.offset_ns + now - second - 1, now));
}

}  // namespace
}  // namespace ledgerline::agent
