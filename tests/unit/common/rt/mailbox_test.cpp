#include "common/rt/mailbox.hpp"

#include <gtest/gtest.h>
#include <poll.h>

#include <array>
#include <chrono>
#include <memory>
#include <thread>
#include <vector>

#include "tests/unit/campaign.hpp"

namespace ledgerline {
namespace {

using Box = Mailbox<std::uint64_t>;

bool readable(const Box& box) {
  pollfd fd{.fd = box.wake_fd(), .events = POLLIN, .revents = 0};
  return ::poll(&fd, 1, 0) == 1;
}

TEST(Mailbox, WakesTheLoopWhileThereIsSomethingToTake) {
  Box box;
  EXPECT_FALSE(readable(box));
  box.put_in_turn(1);
  box.put(2);
  EXPECT_TRUE(readable(box));
  EXPECT_EQ(box.pop_all().size(), 2U);
  EXPECT_FALSE(readable(box));
}

TEST(Mailbox, ItsLoopIsWokenWithoutAnEventToo) {
  Box box;
  box.wait(0);
  box.wake();
  box.wait(60 * ns_per_s);
  EXPECT_TRUE(box.pop_all().empty());
  EXPECT_FALSE(readable(box));
}

TEST(Mailbox, EventsComeInOrderAndNoneIsLostHoweverSlowTheLoopIs) {
  Box box(4);
  constexpr std::uint64_t count = 5000;
  std::thread stream([&] {
    for (std::uint64_t k = 0; k < count; ++k) box.put_in_turn(k);
  });
  std::uint64_t next = 0;
  std::size_t most = 0;
  while (next < count) {
    const auto events = box.pop_all();
    most = std::max(most, events.size());
    for (const std::uint64_t event : events) EXPECT_EQ(event, next++);
  }
  stream.join();
  EXPECT_LE(most, 4U) << "a full box makes the stream wait";
}

TEST(Mailbox, OtherEventsNeverWaitForRoom) {
  Box box(1);
  box.put_in_turn(1);
  for (int i = 0; i < 10; ++i) box.put(9);
  EXPECT_EQ(box.pop_all().size(), 11U);
}

TEST(Mailbox, ClosingLetsTheStreamGoAndThrowsAwayWhatComesLater) {
  Box box(1);
  box.put_in_turn(1);
  std::thread stream([&] { box.put_in_turn(2); });
  box.close();
  stream.join();
  box.put(9);
  EXPECT_EQ(box.pop_all().size(), 1U);
}

TEST(Mailbox, EventsThatNobodyTookEndWithTheMailbox) {
  const auto event = std::make_shared<int>(1);
  {
    Mailbox<std::shared_ptr<int>> box;
    box.put(event);
    box.put_in_turn(event);
    EXPECT_EQ(event.use_count(), 3);
  }
  EXPECT_EQ(event.use_count(), 1);
}

/// As in agent and ground: a stream that waits for room, others that never wait, a loop that sleeps until it is woken.
/// It fails when the loop clears its descriptor behind the take, and when a full box forgets who waits.
TEST(Mailbox, OfManyThreadsNothingIsLostDoubledOrOutOfOrderAndNoWakeIsMissed) {
  constexpr std::uint64_t threads = 4;
  const auto each = static_cast<std::uint64_t>(seeds(20'000, 2'000'000));
  Box box(4);
  std::vector<std::thread> writers;
  for (std::uint64_t t = 0; t < threads; ++t) {
    writers.emplace_back([&, t] {
      for (std::uint64_t k = 0; k < each; ++k) {
        if (t < 2) {
          box.put_in_turn(t + threads * k);
        } else {
          box.put(t + threads * k);
          if (k % 16 == 0) std::this_thread::yield();
        }
      }
    });
  }
  std::array<std::uint64_t, threads> next{};
  std::uint64_t taken = 0, wrong = 0, missed = 0;
  while (taken < threads * each && missed == 0) {
    const TimeNs before = monotonic_ns();
    box.wait(5 * ns_per_s);
    missed += monotonic_ns() - before >= 5 * ns_per_s ? 1 : 0;
    for (const std::uint64_t event : box.pop_all()) {
      wrong += event / threads == next[event % threads]++ ? 0 : 1;
      ++taken;
    }
  }
  box.close();
  for (std::thread& writer : writers) writer.join();
  EXPECT_EQ(taken, threads * each);
  EXPECT_EQ(wrong, 0U);
  EXPECT_EQ(missed, 0U);
}

TEST(Mailbox, WhoWaitsForRoomIsLetInByEachTake) {
  Box box(1);
  std::thread stream([&] {
    for (std::uint64_t k = 0; k < 100; ++k) box.put_in_turn(k);
  });
  for (std::uint64_t k = 0; k < 100;) {
    std::this_thread::sleep_for(std::chrono::microseconds(200));  // it waits by now
    const auto events = box.pop_all();
    ASSERT_LE(events.size(), 1U);
    for (const std::uint64_t event : events) EXPECT_EQ(event, k++);
  }
  stream.join();
}

}  // namespace
}  // namespace ledgerline
