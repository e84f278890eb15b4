#include "common/rt/spsc_ring.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <cstdint>
#include <thread>

#include "tests/unit/campaign.hpp"

namespace ledgerline {
namespace {

TEST(SpscRing, IsFirstInFirstOut) {
  SpscRing<int, 8> ring;
  int out = 0;
  EXPECT_FALSE(ring.pop(out));
  for (int round = 0; round < 5; ++round) {  // wraps around
    for (int i = 0; i < 6; ++i) EXPECT_TRUE(ring.push(round * 10 + i));
    EXPECT_EQ(ring.size(), 6U);
    for (int i = 0; i < 6; ++i) {
      ASSERT_TRUE(ring.pop(out));
      EXPECT_EQ(out, round * 10 + i);
    }
  }
  EXPECT_FALSE(ring.pop(out));
}

TEST(SpscRing, AFullRingRefusesAndKeepsWhatItHas) {
  SpscRing<int, 4> ring;
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(ring.push(i));
  EXPECT_FALSE(ring.push(99));
  EXPECT_EQ(ring.size(), 4U);
  for (int i = 0, out = -1; i < 4; ++i) {
    EXPECT_TRUE(ring.pop(out));
    EXPECT_EQ(out, i);
  }
}

/// Wide enough that a torn copy shows.
struct Element {
  std::uint64_t number = 0;
  std::uint64_t copies[7] = {};
};

TEST(SpscRing, TwoThreadsLoseTearAndRepeatNothing) {
  const auto count = static_cast<std::uint64_t>(seeds(200'000, 20'000'000));
  SpscRing<Element, 16> ring;
  std::thread producer([&] {
    Element element;
    for (std::uint64_t i = 1; i <= count; ++i) {
      element.number = i;
      for (auto& copy : element.copies) copy = i;
      while (!ring.push(element)) std::this_thread::yield();
    }
  });
  std::uint64_t wrong = 0;
  Element element;
  for (std::uint64_t i = 1; i <= count; ++i) {
    while (!ring.pop(element)) std::this_thread::yield();
    if (element.number != i) ++wrong;
    for (const auto copy : element.copies) {
      if (copy != i) ++wrong;
    }
  }
  producer.join();
  EXPECT_EQ(wrong, 0U);
  EXPECT_FALSE(ring.pop(element));
}

/// As in link's loop: nobody waits for the other. What is refused is missing at the other end, and nothing else.
TEST(SpscRing, AFullRingLosesWhatItRefusedAndAThirdThreadMayLook) {
  const auto count = static_cast<std::uint64_t>(seeds(200'000, 20'000'000));
  SpscRing<Element, 16> ring;
  std::atomic<bool> produced{false};
  std::uint64_t refused = 0, taken = 0, last = 0, wrong = 0, over = 0;
  std::thread producer([&] {
    Element element;
    for (std::uint64_t i = 1; i <= count; ++i) {
      element.number = i;
      for (auto& copy : element.copies) copy = i;
      if (!ring.push(element)) ++refused;
      if (i % 64 == 0) std::this_thread::yield();
    }
    produced = true;
  });
  std::thread watcher([&] {
    while (!produced) over += ring.size() > 16 ? 1 : 0;
  });
  const auto drain = [&] {
    for (Element element; ring.pop(element);) {
      wrong += element.number > last && element.copies[6] == element.number ? 0 : 1;
      last = element.number;
      ++taken;
    }
  };
  while (!produced) drain();
  drain();
  producer.join();
  watcher.join();
  EXPECT_EQ(taken + refused, count);
  EXPECT_EQ(wrong, 0U);
  EXPECT_EQ(over, 0U);
}

}  // namespace
}  // namespace ledgerline
