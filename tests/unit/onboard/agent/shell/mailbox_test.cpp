#include "onboard/agent/shell/mailbox.hpp"

#include <gtest/gtest.h>
#include <poll.h>

#include <atomic>
#include <thread>

namespace ledgerline::agent {
namespace {

fabric::Block block(std::uint64_t number) {
  fabric::Block b;
  b.number = number;
  return b;
}

bool readable(const Mailbox& box) {
  pollfd fd{.fd = box.wake_fd(), .events = POLLIN, .revents = 0};
  return ::poll(&fd, 1, 0) == 1;
}

TEST(Mailbox, WakesTheLoopWhileThereIsSomethingToTake) {
  Mailbox box;
  EXPECT_FALSE(readable(box));
  box.put_block(block(1));
  box.put(FrameEnded{.frame = 2, .outcome = {}});
  EXPECT_TRUE(readable(box));
  EXPECT_EQ(box.take_all().size(), 2U);
  EXPECT_FALSE(readable(box));
}

TEST(Mailbox, LettersComeInOrderAndNoneIsLostHoweverSlowTheLoopIs) {
  Mailbox box(4);
  constexpr std::uint64_t count = 5000;
  std::thread stream([&] {
    for (std::uint64_t k = 0; k < count; ++k) box.put_block(block(k));
  });
  std::uint64_t next = 0;
  std::size_t most = 0;
  while (next < count) {
    const auto letters = box.take_all();
    most = std::max(most, letters.size());
    for (const Letter& letter : letters) EXPECT_EQ(std::get<fabric::Block>(letter).number, next++);
  }
  stream.join();
  EXPECT_LE(most, 4U) << "a full box makes the stream wait";
}

TEST(Mailbox, OtherLettersNeverWaitForRoom) {
  Mailbox box(1);
  box.put_block(block(1));
  for (int i = 0; i < 10; ++i) box.put(StreamState{});
  EXPECT_EQ(box.take_all().size(), 11U);
}

TEST(Mailbox, ClosingLetsTheStreamGoAndThrowsAwayWhatComesLater) {
  Mailbox box(1);
  box.put_block(block(1));
  std::thread stream([&] { box.put_block(block(2)); });
  box.close();
  stream.join();
  box.put(StreamState{});
  EXPECT_EQ(box.take_all().size(), 1U);
}

}  // namespace
}  // namespace ledgerline::agent
