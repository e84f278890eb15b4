#include "common/program/service_manager.hpp"

#include <gmock/gmock.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>

namespace ledgerline {
namespace {

using ::testing::HasSubstr;

TEST(WatchdogPace, SpeaksAtHalfTheManagersTimeout) {
  WatchdogPace pace(2 * ns_per_s);
  EXPECT_TRUE(pace.should_notify(10 * ns_per_s, 1));
  EXPECT_FALSE(pace.should_notify(10'999 * ns_per_ms, 2));
  EXPECT_TRUE(pace.should_notify(11 * ns_per_s, 3));
}

TEST(WatchdogPace, IsSilentWhileTheWorkStandsStillAndSpeaksAtOnceWhenItGoesOn) {
  WatchdogPace pace(2 * ns_per_s);
  EXPECT_FALSE(pace.should_notify(ns_per_s, 0)) << "nothing was done yet";
  EXPECT_TRUE(pace.should_notify(10 * ns_per_s, 7));
  for (TimeNs now = 10 * ns_per_s; now < 60 * ns_per_s; now += 10 * ns_per_ms) ASSERT_FALSE(pace.should_notify(now, 7));
  EXPECT_TRUE(pace.should_notify(60 * ns_per_s, 8));
}

TEST(WatchdogPace, IsSilentWhereNobodyWatches) { EXPECT_FALSE(WatchdogPace(0).should_notify(10 * ns_per_s, 1)); }

/// A service manager's end of the socket, and the variables that name it.
class ServiceManagerTest : public ::testing::Test {
 protected:
  ~ServiceManagerTest() override {
    for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"}) ::unsetenv(name);
    if (fd_ >= 0) ::close(fd_);
    if (!path_.empty()) ::unlink(path_.c_str());
  }

  void listen(const std::string& name) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    if (name[0] == '@') {
      address.sun_path[0] = '\0';
    } else {
      path_ = name;
    }
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size() + (name[0] == '@' ? 0 : 1));
    fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    ASSERT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&address), size), 0) << std::strerror(errno);
    ::setenv("NOTIFY_SOCKET", name.c_str(), 1);
  }

  std::string heard() const {
    char text[64];
    const ssize_t n = ::recv(fd_, text, sizeof text, 0);
    return n < 0 ? "" : std::string(text, static_cast<std::size_t>(n));
  }

  static std::string why_not() {
    const auto manager = ServiceManager::from_environment();
    return manager ? "" : manager.error().message;
  }

  int fd_ = -1;
  std::string path_;
};

TEST_F(ServiceManagerTest, IsReportedByOneDatagramEach) {
  listen(::testing::TempDir() + "/notify_" + std::to_string(::getpid()));
  ::setenv("WATCHDOG_USEC", "2000000", 1);
  auto manager = ServiceManager::from_environment();
  ASSERT_TRUE(manager.ok()) << manager.error().message;
  EXPECT_TRUE(manager->ready().ok());
  EXPECT_EQ(heard(), "READY=1");
  EXPECT_TRUE(manager->alive(10 * ns_per_s, 1).ok());
  EXPECT_EQ(heard(), "WATCHDOG=1");
  EXPECT_TRUE(manager->alive(10'500 * ns_per_ms, 2).ok());
  EXPECT_TRUE(manager->alive(12 * ns_per_s, 1).ok());
  EXPECT_EQ(heard(), "") << "too early, and without progress";
}

TEST_F(ServiceManagerTest, IsFoundByAnAbstractNameToo) {
  listen("@ledgerline/notify/" + std::to_string(::getpid()));
  auto manager = ServiceManager::from_environment();
  ASSERT_TRUE(manager.ok()) << manager.error().message;
  EXPECT_TRUE(manager->ready().ok());
  EXPECT_EQ(heard(), "READY=1");
}

TEST_F(ServiceManagerTest, AProgramThatRequestsNoWatchdogGetsNone) {
  listen(::testing::TempDir() + "/notify_" + std::to_string(::getpid()));
  auto unwatched = ServiceManager::from_environment();
  ASSERT_TRUE(unwatched.ok());
  EXPECT_TRUE(unwatched->alive(10 * ns_per_s, 1).ok());
  ::setenv("WATCHDOG_USEC", "2000000", 1);
  ::setenv("WATCHDOG_PID", std::to_string(::getppid()).c_str(), 1);
  auto of_another = ServiceManager::from_environment();
  ASSERT_TRUE(of_another.ok());
  EXPECT_TRUE(of_another->alive(10 * ns_per_s, 1).ok());
  EXPECT_EQ(heard(), "");
}

TEST_F(ServiceManagerTest, IsNotifiedByAThreadWhileTheWorkProgressesAndNotWhileItStandsStill) {
  listen("@ledgerline/notify/" + std::to_string(::getpid()));
  ::setenv("WATCHDOG_USEC", "100000", 1);
  auto manager = ServiceManager::from_environment();
  ASSERT_TRUE(manager.ok());
  std::atomic<std::uint64_t> turns{0};
  std::atomic<bool> goes_on{true};
  const WatchdogThread watchdog(
      *manager, [&] { return goes_on ? ++turns : turns.load(); }, 0);
  for (int datagrams = 0; datagrams < 3; ::usleep(1000)) datagrams += heard() == "WATCHDOG=1";  // this thread is free
  goes_on = false;
  ::usleep(200'000);
  (void)heard();  // of the last turns
  ::usleep(300'000);
  EXPECT_EQ(heard(), "");
  EXPECT_EQ(watchdog.failed(), 0U);
}

TEST_F(ServiceManagerTest, WithoutOneNothingIsSentAndNothingFails) {
  auto manager = ServiceManager::from_environment();
  ASSERT_TRUE(manager.ok());
  EXPECT_TRUE(manager->ready().ok());
  EXPECT_TRUE(manager->alive(10 * ns_per_s, 1).ok());
}

TEST_F(ServiceManagerTest, ThatIsGoneIsAnErrorThatNamesTheMessage) {
  ::setenv("NOTIFY_SOCKET", (::testing::TempDir() + "/notify_of_nobody").c_str(), 1);
  auto manager = ServiceManager::from_environment();
  ASSERT_TRUE(manager.ok());
  const Status reported = manager->ready();
  ASSERT_FALSE(reported.ok());
  EXPECT_THAT(reported.error().message, HasSubstr("not sent READY=1: No such file"));
}

TEST_F(ServiceManagerTest, VariablesThatCannotBeMeantAreRefused) {
  for (const std::string& socket : {std::string("vsock:2:1234"), std::string("@"), "/" + std::string(200, 'x')}) {
    ::setenv("NOTIFY_SOCKET", socket.c_str(), 1);
    EXPECT_THAT(why_not(), HasSubstr("NOTIFY_SOCKET is \"" + socket));
  }
  ::unsetenv("NOTIFY_SOCKET");
  for (const char* number : {"2s", "-1", "0", "99999999999999999999"}) {
    ::setenv("WATCHDOG_USEC", number, 1);
    EXPECT_THAT(why_not(), HasSubstr("WATCHDOG_USEC is \"" + std::string(number)));
  }
  ::setenv("WATCHDOG_USEC", "86400000001", 1);
  EXPECT_THAT(why_not(), HasSubstr("longer than a day"));
}

}  // namespace
}  // namespace ledgerline
