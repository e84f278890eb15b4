#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <memory>

#include "chaincode/network/processes/processes.hpp"

namespace ledgerline::network {
namespace {

using testing::HasSubstr;

constexpr Restarts::Limits limits{3, 60 * ns_per_s, 100 * ns_per_ms, 300 * ns_per_ms};

class ProcessesTest : public testing::Test {
 protected:
  ProcessesTest() : logs_(testing::TempDir() + "ledgerline_processes_" + std::to_string(::getpid())) {
    std::filesystem::remove_all(logs_);
    std::filesystem::create_directories(logs_);
  }
  ~ProcessesTest() override { std::filesystem::remove_all(logs_); }

  Status start(const std::string& name, const std::string& script) {
    return processes().start(name, "127.0.0.1:1", {"/bin/sh", "-c", script}, {});
  }
  Processes& processes() {
    if (!processes_) processes_ = std::make_unique<Processes>(logs_, limits);
    return *processes_;
  }
  /// Tends until `good`, or the network ends.
  template <typename Condition>
  Status tend_until(Condition good) {
    for (const TimeNs until = monotonic_ns() + 60 * ns_per_s; !good() && monotonic_ns() < until;) {
      if (Status s = processes().poll(10 * ns_per_ms); !s) return s;
    }
    return good() ? Status(done) : Status(Error{"not within a minute"});
  }

  const std::string logs_;
  std::unique_ptr<Processes> processes_;
};

TEST_F(ProcessesTest, AKilledProcessIsStartedAgainAndCounted) {
  ASSERT_TRUE(start("peer1", "exec sleep 1000").ok());
  ASSERT_TRUE(start("peer2", "exec sleep 1000").ok());
  processes().supervise();
  const pid_t first = processes().states()[0].pid, other = processes().states()[1].pid;
  ASSERT_GT(first, 0);
  ::kill(first, SIGKILL);
  const auto again = [&] { return processes().states()[0].restarts == 1 && processes().states()[0].pid > 0; };
  const Status status = tend_until(again);
  ASSERT_TRUE(status.ok()) << status.error().message;
  EXPECT_NE(processes().states()[0].pid, first);
  EXPECT_EQ(processes().states()[1].pid, other) << "the other one goes on";
  EXPECT_EQ(processes().states()[1].restarts, 0U);
  EXPECT_TRUE(processes().stop());
}

TEST_F(ProcessesTest, OneOfTheBackgroundIsThereAgainAfterItsEnd) {
  ASSERT_TRUE(
      processes().start("peer3", "127.0.0.1:1", {"/bin/sh", "-c", "exec sleep 1000"}, {}, Scheduling::background).ok());
  processes().supervise();
  const auto in_background = [&] {
    const pid_t pid = processes().states()[0].pid;
    return pid > 0 && ::sched_getscheduler(pid) == SCHED_BATCH &&
           ::getpriority(PRIO_PROCESS, static_cast<id_t>(pid)) == 19;
  };
  EXPECT_TRUE(tend_until(in_background).ok());
  const pid_t first = processes().states()[0].pid;
  ::kill(first, SIGKILL);
  const Status again = tend_until([&] { return processes().states()[0].pid != first && in_background(); });
  EXPECT_TRUE(again.ok()) << again.error().message;
  EXPECT_TRUE(processes().stop());
}

TEST_F(ProcessesTest, AProcessThatEndsAgainAndAgainEndsTheNetworkWithItsLastLines) {
  ASSERT_TRUE(start("orderer1", "echo the disk is gone >&2; exit 7").ok());
  processes().supervise();
  const Status status = tend_until([] { return false; });
  ASSERT_FALSE(status.ok());
  EXPECT_THAT(status.error().message, HasSubstr("orderer1 ended with exit code 7"));
  EXPECT_THAT(status.error().message, HasSubstr("given up"));
  EXPECT_THAT(status.error().message, HasSubstr("the disk is gone"));
  EXPECT_EQ(processes().states()[0].restarts, static_cast<std::uint64_t>(limits.max_restarts));
}

TEST_F(ProcessesTest, AProcessThatEndsDuringTheStartIsAnErrorWithItsLastLines) {
  ASSERT_TRUE(start("peer1", "for i in 1 2 3 4 5 6 7 8 9 10 11; do echo line $i >&2; done; exit 3").ok());
  const Status status = tend_until([] { return false; });
  ASSERT_FALSE(status.ok());
  EXPECT_THAT(status.error().message, HasSubstr("peer1 ended with exit code 3"));
  EXPECT_THAT(status.error().message, HasSubstr("line 2\n"));
  EXPECT_THAT(status.error().message, testing::Not(HasSubstr("line 1\n"))) << "the last ten";
  EXPECT_EQ(processes().states()[0].restarts, 0U);
}

TEST_F(ProcessesTest, ACommandIsRepeatedUntilItSucceedsOrSaysWhatIsGoodToo) {
  const std::string file = logs_ + "/tries";
  const std::string third = "echo x >> " + file + "; [ $(wc -l < " + file + ") -ge 3 ]";
  EXPECT_TRUE(processes().run_until_good("joining", {"/bin/sh", "-c", third}, {}, 60 * ns_per_s).ok());
  const std::vector<std::string> already{"/bin/sh", "-c", "echo already there >&2; false"};
  EXPECT_TRUE(processes().run_until_good("joining", already, {}, ns_per_s, "already there").ok());
  const Status status = processes().run_until_good("joining", already, {}, 100 * ns_per_ms);
  ASSERT_FALSE(status.ok());
  EXPECT_THAT(status.error().message, HasSubstr("joining ended with exit code 1"));
  EXPECT_THAT(status.error().message, HasSubstr("already there"));
}

}  // namespace
}  // namespace ledgerline::network
