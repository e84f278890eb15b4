#include "onboard/ipc/bell.hpp"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstring>
#include <thread>

#include "common/rt/spsc_ring.hpp"

namespace ledgerline::ipc {
namespace {

class Bells : public ::testing::Test {
 protected:
  void TearDown() override {
    ::unlink(path.c_str());
    ::rmdir(folder.c_str());
  }
  static bool wait(const Bell& bell, int timeout_ms) {
    pollfd fd{.fd = bell.fd(), .events = POLLIN, .revents = 0};
    return ::poll(&fd, 1, timeout_ms) == 1;
  }
  std::unique_ptr<Bell> hang() const {
    auto bell = Bell::create(path);
    EXPECT_TRUE(bell) << bell.error().what;
    return bell ? std::move(*bell) : nullptr;
  }
  BellRope rope() const { return BellRope::create(path).value(); }

  std::string folder = [] {
    char name[] = "/tmp/bell_test.XXXXXX";
    return std::string(::mkdtemp(name));
  }();
  std::string path = folder + "/bell";
};

TEST_F(Bells, ARingIsSeenOnce) {
  const auto bell = hang();
  BellRope rope = this->rope();
  EXPECT_FALSE(wait(*bell, 0));
  EXPECT_FALSE(bell->clear());
  rope.pull();
  rope.pull();
  EXPECT_TRUE(wait(*bell, 0));
  EXPECT_TRUE(bell->clear());
  EXPECT_FALSE(wait(*bell, 0));
  EXPECT_FALSE(bell->clear());
}

TEST_F(Bells, WhoRingsAFullBellDoesNotWait) {
  const auto bell = hang();
  BellRope rope = this->rope();
  for (int i = 0; i < 10'000; ++i) rope.pull();
  EXPECT_TRUE(bell->clear());
  EXPECT_FALSE(wait(*bell, 0)) << "one look is enough for all of them";
}

TEST_F(Bells, NobodyIsThereAndARingIsNoHarm) {
  BellRope rope = this->rope();
  rope.pull();
  hang().reset();
  rope.pull();
  EXPECT_NE(::access(path.c_str(), F_OK), 0) << "an owner that ends leaves nothing";
}

TEST_F(Bells, AnOwnerThatStartsAnewBehindAKilledOneIsHeard) {
  BellRope rope = this->rope();
  // As a killed one leaves it: a name that no socket answers to.
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  const int killed = ::socket(AF_UNIX, SOCK_DGRAM, 0);
  ASSERT_EQ(::bind(killed, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ::close(killed);
  rope.pull();
  const auto bell = hang();
  ASSERT_TRUE(bell);
  rope.pull();
  EXPECT_TRUE(bell->clear());
}

TEST_F(Bells, OtherUsersMayNotRingWhateverTheUmask) {
  const mode_t before = ::umask(0);
  const auto bell = hang();
  ::umask(before);
  struct stat info {};
  ASSERT_EQ(::stat(path.c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0600U);
}

TEST_F(Bells, APlaceThatCannotBeTakenIsNamed) {
  ASSERT_EQ(::mkdir(path.c_str(), 0700), 0);
  const auto taken = Bell::create(path);
  ::rmdir(path.c_str());
  ASSERT_FALSE(taken);
  EXPECT_NE(taken.error().what.find(path), std::string::npos) << taken.error().what;
  EXPECT_FALSE(Bell::create(std::string(200, 'x')));
  EXPECT_FALSE(BellRope::create(std::string(200, 'x')));
}

/// As link's courier and agent: something is put where the other looks, then the bell rings; the other clears the bell,
/// then looks. It fails when the other looks first, and when a full bell loses what came last.
TEST_F(Bells, NoLookIsMissedHoweverFullTheBellIs) {
  constexpr std::uint64_t count = 100'000;
  const auto bell = hang();
  SpscRing<std::uint64_t, 64> ring;
  std::thread courier([&, rope = this->rope()]() mutable {
    for (std::uint64_t i = 1; i <= count; ++i) {
      while (!ring.push(i)) std::this_thread::yield();
      rope.pull();
      if (i % 64 == 0) std::this_thread::yield();  // now and then the other sleeps
    }
  });
  std::uint64_t last = 0, missed = 0;
  while (last < count) {
    if (!wait(*bell, 2000)) ++missed;
    bell->clear();
    while (ring.pop(last)) {
    }
  }
  courier.join();
  EXPECT_EQ(missed, 0U);
}

}  // namespace
}  // namespace ledgerline::ipc
