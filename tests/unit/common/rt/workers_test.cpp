#include "common/rt/workers.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <memory>
#include <thread>

namespace ledgerline {
namespace {

TEST(Workers, EndBehindAllThatWaitsOrBehindWhatHasBegun) {
  for (const bool drops : {false, true}) {
    Workers workers("test", 1);
    std::atomic<int> done{0};
    std::promise<void> begun, go_on;
    EXPECT_TRUE(workers.post([&] {
      begun.set_value();
      go_on.get_future().wait();
      ++done;
    }));
    begun.get_future().wait();
    const auto held = std::make_shared<int>(1);
    for (int i = 0; i < 3; ++i) EXPECT_TRUE(workers.post([&, held] { ++done; }));
    std::thread ending([&] { workers.close(drops ? Workers::Waiting::dropped : Workers::Waiting::finished); });
    while (drops && held.use_count() > 1) std::this_thread::yield();  // what is dropped is so at once
    go_on.set_value();
    ending.join();
    EXPECT_EQ(done, drops ? 1 : 4);
    EXPECT_EQ(held.use_count(), 1);
    EXPECT_FALSE(workers.post([] {}));
  }
}

}  // namespace
}  // namespace ledgerline
