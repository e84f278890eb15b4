#include "onboard/roudi/broker.hpp"

#include <gtest/gtest.h>

namespace ledgerline::roudi {
namespace {

constexpr LeakWatch::Chunks kept{2, 1, 1};

TEST(LeakWatch, WhatIsInTransitIsNotLost) {
  LeakWatch watch(kept);
  for (std::uint32_t i = 0; i < 100; ++i) watch.update({2 + i % 7, 1 + i % 3, i % 5});
  EXPECT_EQ(watch.leaked(), 0U);
}

TEST(LeakWatch, OneChunkThatStaysInUseIsLost) {
  LeakWatch watch(kept);
  for (std::size_t i = 0; i + 1 < LeakWatch::looks; ++i) watch.update({2, 2, 1});
  EXPECT_EQ(watch.leaked(), 0U) << "a few looks say nothing";
  watch.update({2, 2, 1});
  EXPECT_EQ(watch.leaked(), 1U);
}

TEST(LeakWatch, ChunksOfAllPoolsAreAddedUp) {
  LeakWatch watch(kept);
  for (std::size_t i = 0; i < LeakWatch::looks; ++i) watch.update({5, 2, 9});
  EXPECT_EQ(watch.leaked(), 3U + 1U + 8U);
}

TEST(LeakWatch, AReaderThatStoodStillAndGoesOnHasLostNothing) {
  LeakWatch watch(kept);
  for (std::size_t i = 0; i < 2 * LeakWatch::looks; ++i) watch.update({2, 100, 1});
  EXPECT_EQ(watch.leaked(), 99U);
  watch.update({2, 1, 1});
  EXPECT_EQ(watch.leaked(), 0U);
  EXPECT_EQ(watch.max_leaked(), 99U);
}

}  // namespace
}  // namespace ledgerline::roudi
