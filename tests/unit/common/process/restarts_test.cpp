#include <gtest/gtest.h>

#include <set>

#include "common/process/children.hpp"

namespace ledgerline {
namespace {

constexpr Restarts::Limits restart_limits{3, 60 * ns_per_s, 100 * ns_per_ms, 300 * ns_per_ms};

TEST(Restarts, WaitsAreDoubledUpToTheMaximumAndAtMostAHalfIsLeftOut) {
  Restarts restarts(restart_limits, 1);
  TimeNs now = 5 * ns_per_s;
  for (const TimeNs wait : {100 * ns_per_ms, 200 * ns_per_ms, 300 * ns_per_ms}) {
    const auto at = restarts.ended(now);
    ASSERT_TRUE(at.has_value());
    EXPECT_GE(*at, now + wait / 2);
    EXPECT_LE(*at, now + wait);
    now = *at;
  }
  EXPECT_EQ(restarts.count(), 3U);
}

TEST(Restarts, AnEndTooManyWithinTheTimeIsTheLast) {
  Restarts restarts(restart_limits, 1);
  for (int i = 0; i < restart_limits.max_restarts; ++i) ASSERT_TRUE(restarts.ended(i * ns_per_s).has_value());
  EXPECT_FALSE(restarts.ended(restart_limits.within - 1).has_value());
  EXPECT_EQ(restarts.count(), 3U);
}

TEST(Restarts, EndsLongAgoAreForgotten) {
  Restarts restarts(restart_limits, 1);
  for (int i = 0; i < 100; ++i) {
    const TimeNs now = i * (restart_limits.within / 2);  // never more than three within the time
    const auto at = restarts.ended(now);
    ASSERT_TRUE(at.has_value()) << i;
    EXPECT_LE(*at, now + restart_limits.max_wait);
  }
  const TimeNs later = 1000 * restart_limits.within;
  EXPECT_LE(*restarts.ended(later), later + restart_limits.first_wait) << "the wait is short again";
}

TEST(Restarts, ProcessesThatEndTogetherDoNotStartTogether) {
  std::set<TimeNs> starts;
  for (std::uint64_t seed = 0; seed < 9; ++seed) starts.insert(*Restarts(restart_limits, seed).ended(0));
  EXPECT_EQ(starts.size(), 9U);
}

}  // namespace
}  // namespace ledgerline
