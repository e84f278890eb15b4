#include "onboard/ipc/ipc.hpp"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <ostream>
#include <sstream>
#include <thread>

#include "common/rt/spsc_ring.hpp"
#include "onboard/ipc/bounded_lines.hpp"

namespace ledgerline::ipc {
namespace {

class Wakeups : public ::testing::Test {
 protected:
  void TearDown() override {
    ::unlink(path.c_str());
    ::rmdir(folder.c_str());
  }
  static bool wait(const WakeupSink& wakeup, int timeout_ms) {
    pollfd fd{.fd = wakeup.fd(), .events = POLLIN, .revents = 0};
    return ::poll(&fd, 1, timeout_ms) == 1;
  }
  std::unique_ptr<WakeupSink> make_sink() const {
    auto wakeup = WakeupSink::create(path);
    EXPECT_TRUE(wakeup) << wakeup.error().message;
    return wakeup ? std::move(*wakeup) : nullptr;
  }
  WakeupSource make_source() const { return WakeupSource::create(path).value(); }

  std::string folder = [] {
    char name[] = "/tmp/wakeup_test.XXXXXX";
    return std::string(::mkdtemp(name));
  }();
  std::string path = folder + "/wakeup";
};

TEST_F(Wakeups, ANotificationIsSeenOnce) {
  const auto wakeup = make_sink();
  WakeupSource source = make_source();
  EXPECT_FALSE(wait(*wakeup, 0));
  EXPECT_FALSE(wakeup->clear());
  source.notify();
  source.notify();
  EXPECT_TRUE(wait(*wakeup, 0));
  EXPECT_TRUE(wakeup->clear());
  EXPECT_FALSE(wait(*wakeup, 0));
  EXPECT_FALSE(wakeup->clear());
}

TEST_F(Wakeups, NotifyingAFullSinkDoesNotWait) {
  const auto wakeup = make_sink();
  WakeupSource source = make_source();
  for (int i = 0; i < 10'000; ++i) source.notify();
  EXPECT_TRUE(wakeup->clear());
  EXPECT_FALSE(wait(*wakeup, 0)) << "one read is enough for all of them";
}

TEST_F(Wakeups, NotifyingWithoutASinkDoesNoHarm) {
  WakeupSource source = make_source();
  source.notify();
  make_sink().reset();
  source.notify();
  EXPECT_NE(::access(path.c_str(), F_OK), 0) << "an owner that ends leaves nothing";
}

TEST_F(Wakeups, ASinkThatReplacesAKilledOneIsNotified) {
  WakeupSource source = make_source();
  // As a killed one leaves it: a name that no socket answers to.
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  const int killed = ::socket(AF_UNIX, SOCK_DGRAM, 0);
  ASSERT_EQ(::bind(killed, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ::close(killed);
  source.notify();
  const auto wakeup = make_sink();
  ASSERT_TRUE(wakeup);
  source.notify();
  EXPECT_TRUE(wakeup->clear());
}

TEST_F(Wakeups, OtherUsersMayNotNotifyWhateverTheUmask) {
  const mode_t before = ::umask(0);
  const auto wakeup = make_sink();
  ::umask(before);
  struct stat info {};
  ASSERT_EQ(::stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U);
}

TEST_F(Wakeups, APathThatIsTakenIsNamed) {
  ASSERT_EQ(::mkdir(path.c_str(), 0700), 0);
  const auto taken = WakeupSink::create(path);
  ::rmdir(path.c_str());
  ASSERT_FALSE(taken);
  EXPECT_NE(taken.error().message.find(path), std::string::npos) << taken.error().message;
  EXPECT_FALSE(WakeupSink::create(std::string(200, 'x')));
  EXPECT_FALSE(WakeupSource::create(std::string(200, 'x')));
}

/// As link's publisher and agent: one side pushes into the ring, then notifies; the other clears the sink, then reads.
/// It fails when the reader reads first, and when a full sink loses the last notification.
TEST_F(Wakeups, NoWakeupIsMissedHoweverFullTheSinkIs) {
  constexpr std::uint64_t count = 100'000;
  const auto wakeup = make_sink();
  SpscRing<std::uint64_t, 64> ring;
  std::thread publisher([&, source = make_source()]() mutable {
    for (std::uint64_t i = 1; i <= count; ++i) {
      while (!ring.push(i)) std::this_thread::yield();
      source.notify();
      if (i % 64 == 0) std::this_thread::yield();  // now and then the other sleeps
    }
  });
  std::uint64_t last = 0, missed = 0;
  while (last < count) {
    if (!wait(*wakeup, 2000)) ++missed;
    wakeup->clear();
    while (ring.pop(last)) {
    }
  }
  publisher.join();
  EXPECT_EQ(missed, 0U);
}

TimeNs now_ns = 0;

TEST(LinesOfIceoryx, AreBoundedForEachMinute) {
  std::stringbuf passed;
  BoundedLines lines(passed, [] { return now_ns; });
  std::ostream out(&lines);
  for (int i = 0; i < 1'000; ++i) out << "sendto failed: " << i << std::endl;
  const std::string first = passed.str();
  EXPECT_EQ(std::count(first.begin(), first.end(), '\n'), BoundedLines::lines_a_minute + 1);
  EXPECT_TRUE(first.starts_with("sendto failed: 0\n"));
  EXPECT_TRUE(first.ends_with("the further lines of this minute are left out\n"));
  now_ns += 61 * ns_per_s;
  out << "another" << std::endl;
  EXPECT_TRUE(passed.str().ends_with("are left out\nanother\n"));
}

}  // namespace
}  // namespace ledgerline::ipc
