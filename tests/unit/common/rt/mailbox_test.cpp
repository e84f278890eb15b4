#include "common/rt/mailbox.hpp"

#include <gtest/gtest.h>
#include <poll.h>

#include <thread>

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
  EXPECT_EQ(box.take_all().size(), 2U);
  EXPECT_FALSE(readable(box));
}

TEST(Mailbox, ItsLoopIsWokenWithoutALetterToo) {
  Box box;
  box.wait(0);
  box.wake();
  box.wait(60 * ns_per_s);
  EXPECT_TRUE(box.take_all().empty());
  EXPECT_FALSE(readable(box));
}

TEST(Mailbox, LettersComeInOrderAndNoneIsLostHoweverSlowTheLoopIs) {
  Box box(4);
  constexpr std::uint64_t count = 5000;
  std::thread stream([&] {
    for (std::uint64_t k = 0; k < count; ++k) box.put_in_turn(k);
  });
  std::uint64_t next = 0;
  std::size_t most = 0;
  while (next < count) {
    const auto letters = box.take_all();
    most = std::max(most, letters.size());
    for (const std::uint64_t letter : letters) EXPECT_EQ(letter, next++);
  }
  stream.join();
  EXPECT_LE(most, 4U) << "a full box makes the stream wait";
}

TEST(Mailbox, OtherLettersNeverWaitForRoom) {
  Box box(1);
  box.put_in_turn(1);
  for (int i = 0; i < 10; ++i) box.put(9);
  EXPECT_EQ(box.take_all().size(), 11U);
}

TEST(Mailbox, ClosingLetsTheStreamGoAndThrowsAwayWhatComesLater) {
  Box box(1);
  box.put_in_turn(1);
  std::thread stream([&] { box.put_in_turn(2); });
  box.close();
  stream.join();
  box.put(9);
  EXPECT_EQ(box.take_all().size(), 1U);
}

}  // namespace
}  // namespace ledgerline
