#include "onboard/agent/mocap_clock.hpp"

#include <gtest/gtest.h>

namespace ledgerline::agent {
namespace {

constexpr TimeNs second = ns_per_s;

struct Clocks {
  TimeNs offset_ns = 1'000'000 * second;
  int readings = 0;
  MocapClock clock{[this] {
    ++readings;
    return offset_ns;
  }};
};

TEST(MocapClock, TurnsRealTimeIntoTheMonotonicClock) {
  Clocks c;
  EXPECT_EQ(c.clock.stamp(c.offset_ns + 5 * second, 5 * second + 3 * ns_per_ms), 5 * second);
  EXPECT_EQ(c.readings, 1);
}

TEST(MocapClock, AJumpOfRealTimeCostsNoPose) {
  for (const TimeNs jump : {-3600 * second, -2 * second, 30 * ns_per_ms, 60 * second}) {
    Clocks c;
    c.offset_ns += jump;
    EXPECT_EQ(c.clock.stamp(c.offset_ns + 5 * second, 5 * second), 5 * second) << jump;
    EXPECT_EQ(c.readings, 2) << jump;
  }
}

TEST(MocapClock, AStampOfTheFutureOrTheFarPastIsNotBelieved) {
  Clocks c;
  const TimeNs now = 100 * second;
  EXPECT_TRUE(c.clock.stamp(c.offset_ns + now + 20 * ns_per_ms, now));
  EXPECT_FALSE(c.clock.stamp(c.offset_ns + now + 20 * ns_per_ms + 1, now));
  EXPECT_TRUE(c.clock.stamp(c.offset_ns + now - second, now));
  EXPECT_FALSE(c.clock.stamp(c.offset_ns + now - second - 1, now));
}

}  // namespace
}  // namespace ledgerline::agent
