#include "chaincode/endorser/shell/priority_mutex.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

namespace ledgerline::endorser {
namespace {

/// How many of a crowd went first, of the middle one of many tries: a thread may be put aside before it asks.
int overtaken_by_crowd(PriorityMutex& mutex) {
  std::atomic<int> served{0};
  std::vector<std::jthread> crowd;
  for (int i = 0; i < 8; ++i) {
    crowd.emplace_back([&](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        const auto lock = mutex.lock_later();
        ++served;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
  }
  std::array<int, 25> overtaken{};
  for (int& one : overtaken) {
    std::this_thread::sleep_for(std::chrono::milliseconds(3));
    const int before = served;
    const auto lock = mutex.lock_first();
    one = served - before;
  }
  std::nth_element(overtaken.begin(), overtaken.begin() + overtaken.size() / 2, overtaken.end());
  return overtaken[overtaken.size() / 2];
}

TEST(PriorityMutex, WhoComesByTheFirstWaitsForTwoOfACrowdAtMost) {
  PriorityMutex mutex;
  EXPECT_LE(overtaken_by_crowd(mutex), 2);
}

TEST(PriorityMutex, NobodyHasItBesideAnother) {
  PriorityMutex mutex;
  int count = 0;
  {
    std::vector<std::jthread> all;
    for (int i = 0; i < 4; ++i) {
      all.emplace_back([&, i] {
        for (int k = 0; k < 2'000; ++k) {
          const auto lock = i % 2 == 0 ? mutex.lock_first() : mutex.lock_later();
          ++count;
        }
      });
    }
  }
  EXPECT_EQ(count, 8'000);
}

}  // namespace
}  // namespace ledgerline::endorser
