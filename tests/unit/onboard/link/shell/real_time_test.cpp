#include "common/rt/loop_ticker.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/capability.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <thread>

/// Capabilities and scheduling are a thread's own, so each test has one.
namespace ledgerline {
namespace {

using testing::Contains;
using testing::HasSubstr;

void drop_capabilities() {
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  __user_cap_data_struct none[2] = {};
  ASSERT_EQ(::syscall(SYS_capset, &header, none), 0);
}

template <typename Function>
void in_a_thread(Function function) {
  std::thread thread(function);
  thread.join();
}

TEST(RealTime, WhatIsNotPermittedIsANoticeThatNamesTheCure) {
  const rlimit none{0, 0};
  ASSERT_EQ(::setrlimit(RLIMIT_RTPRIO, &none), 0);
  ASSERT_EQ(::setrlimit(RLIMIT_MEMLOCK, &none), 0);
  in_a_thread([] {
    drop_capabilities();
    const RealTime got = enter_real_time(80, 1023);
    EXPECT_FALSE(got.scheduled);
    EXPECT_FALSE(got.locked);
    EXPECT_FALSE(got.all());
    EXPECT_EQ(got.notices.size(), 3U);
    EXPECT_THAT(got.notices, Contains(HasSubstr("CAP_SYS_NICE")));
    EXPECT_THAT(got.notices, Contains(HasSubstr("CAP_IPC_LOCK")));
    EXPECT_THAT(got.notices, Contains(HasSubstr("[realtime] cpu")));
  });
}

TEST(RealTime, NothingAskedForIsNothingToSay) {
  in_a_thread([] {
    const RealTime got = enter_real_time(0, -1);
    EXPECT_TRUE(got.notices.empty());
    EXPECT_EQ(::sched_getscheduler(0), SCHED_OTHER);
  });
}

TEST(RealTime, TheThreadIsPinnedAndFirstAndItsChildrenAreNot) {
  in_a_thread([] {
    cpu_set_t allowed;
    ASSERT_EQ(::sched_getaffinity(0, sizeof allowed, &allowed), 0);
    int cpu = 0;
    while (!CPU_ISSET(static_cast<std::size_t>(cpu), &allowed)) ++cpu;
    const RealTime got = enter_real_time(80, cpu);
    if (!got.scheduled) GTEST_SKIP() << "SCHED_FIFO is not permitted here";
    EXPECT_EQ(::sched_getcpu(), cpu);
    EXPECT_EQ(::sched_getscheduler(0), SCHED_FIFO | SCHED_RESET_ON_FORK);
    sched_param param{};
    ::sched_getparam(0, &param);
    EXPECT_EQ(param.sched_priority, 80);
    in_a_thread([] { EXPECT_EQ(::sched_getscheduler(0), SCHED_OTHER); });
  });
}

}  // namespace
}  // namespace ledgerline
