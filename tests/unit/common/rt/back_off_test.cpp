#include "common/rt/retry.hpp"

#include <gtest/gtest.h>

namespace ledgerline {
namespace {

TEST(BackOff, DoublesToItsMaximumWithJitterAndASuccessResetsIt) {
  BackOff back_off(10 * ns_per_ms, 40 * ns_per_ms);
  Random random(1);
  EXPECT_TRUE(back_off.over(0)) << "nothing failed yet";
  for (const TimeNs max_ms : {10, 20, 40, 40}) {
    back_off.failed(0, random);
    EXPECT_GE(back_off.until_ns(), max_ms * ns_per_ms / 2);
    EXPECT_LE(back_off.until_ns(), max_ms * ns_per_ms);
    EXPECT_FALSE(back_off.over(back_off.until_ns() - 1));
    EXPECT_TRUE(back_off.over(back_off.until_ns()));
  }
  back_off.succeeded();
  EXPECT_LE(back_off.next(random), 10 * ns_per_ms);
}

TEST(RateLimiter, WhatIsWantedOftenIsDoneAtOnceAndThenAtMostOnceInItsGap) {
  RateLimiter limiter(ns_per_s);
  EXPECT_FALSE(limiter.start(1));
  limiter.request();
  EXPECT_TRUE(limiter.start(1));
  int done = 0;
  for (TimeNs now = 2; now < 10 * ns_per_s; now += ns_per_s / 100) {
    limiter.request();
    done += limiter.start(now);
  }
  EXPECT_EQ(done, 9);
  EXPECT_TRUE(limiter.start(20 * ns_per_s)) << "the last one is not lost";
  EXPECT_FALSE(limiter.start(30 * ns_per_s));
}

}  // namespace
}  // namespace ledgerline
