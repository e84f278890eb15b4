#include "tools/launcher/fault_switches.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <mutex>
#include <optional>

#include "tests/unit/served_socket.hpp"

namespace ledgerline::launcher {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

/// Switches of one drone before a proxy that only records its commands.
class SwitchServiceTest : public testing::Test {
 protected:
  SwitchServiceTest() {
    char name[] = "/tmp/ledgerline-switches-XXXXXX";
    path_ = ::mkdtemp(name);
    auto socket = CommandSocket::open(proxy());
    if (!socket) return;
    served_.emplace(std::move(*socket), [this](const std::string& command) -> Result<std::string> {
      const std::lock_guard lock(mutex_);
      reported_.push_back(command);
      return std::string();
    });
    auto service = SwitchService::open(at(), proxy(), {"tello1"});
    if (service) service_ = std::move(*service);
  }
  ~SwitchServiceTest() override {
    service_.reset();
    served_.reset();
    ::rmdir(path_.c_str());
  }
  std::string at() const { return path_ + "/switches.sock"; }
  std::string proxy() const { return path_ + "/faults.sock"; }
  std::vector<std::string> reported() {
    const std::lock_guard lock(mutex_);
    return reported_;
  }
  bool anything_on() const {
    const auto list = send_command(at(), "list");
    return !list || list->find("\"on\":true") != std::string::npos;
  }
  void wait_until_nothing_is_on() const {
    for (int i = 0; i < 1000 && anything_on(); ++i) ::usleep(10'000);
    EXPECT_FALSE(anything_on());
  }

  std::string path_;
  std::mutex mutex_;
  std::vector<std::string> reported_;
  std::optional<ServedSocket> served_;
  std::unique_ptr<SwitchService> service_;
};

TEST_F(SwitchServiceTest, TellsTheProxyAndAnswersWhatIsOn) {
  ASSERT_TRUE(service_);
  EXPECT_FALSE(anything_on());
  const auto on = send_command(at(), "on silent-tello1");
  ASSERT_TRUE(on) << on.error().message;
  EXPECT_THAT(*on, HasSubstr("\"on\":true"));
  EXPECT_THAT(reported(), ElementsAre("drone tello1 from partition"));
  ASSERT_TRUE(send_command(at(), "off silent-tello1"));
  EXPECT_FALSE(anything_on());
  EXPECT_THAT(send_command(at(), "on silent-tello2").error().message, HasSubstr("no switch"));
}

TEST_F(SwitchServiceTest, SwitchesAllOffWhenItIsAskedToAndWhenItEnds) {
  ASSERT_TRUE(service_);
  ASSERT_TRUE(send_command(at(), "on silent-tello1"));
  service_->all_off();
  wait_until_nothing_is_on();
  ASSERT_TRUE(send_command(at(), "on ledger-stalled")) << "not for good";
  service_->end();
  wait_until_nothing_is_on();
  EXPECT_THAT(send_command(at(), "on ledger-stalled").error().message, HasSubstr("the flight ends"));
}

TEST_F(SwitchServiceTest, LeavesNothingOnBehindIt) {
  ASSERT_TRUE(service_);
  ASSERT_TRUE(send_command(at(), "on commands-lost-tello1"));
  service_.reset();
  EXPECT_THAT(reported(), ElementsAre("drone tello1 to partition", "drone tello1 to partition off"));
  EXPECT_FALSE(send_command(at(), "list"));
}

TEST_F(SwitchServiceTest, SaysThatTheProxyDoesNotAnswer) {
  ASSERT_TRUE(service_);
  served_.reset();
  EXPECT_THAT(send_command(at(), "on silent-tello1").error().message, HasSubstr("does not answer"));
  EXPECT_FALSE(anything_on());
}

}  // namespace
}  // namespace ledgerline::launcher
