#include "common/rt/scheduling.hpp"

#include <gtest/gtest.h>
#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <thread>

namespace ledgerline {
namespace {

SchedulingAttributes attributes_of_this_thread() {
  SchedulingAttributes attributes;
  EXPECT_EQ(::syscall(SYS_sched_getattr, 0, &attributes, sizeof attributes, 0), 0);
  return attributes;
}

/// What a thread has that a thread in that class has started.
SchedulingAttributes attributes_after(Scheduling scheduling) {
  SchedulingAttributes attributes;
  std::thread([&] {
    EXPECT_TRUE(enter_scheduling(scheduling));
    std::thread([&] { attributes = attributes_of_this_thread(); }).join();
  }).join();
  return attributes;
}

TEST(Scheduling, TheBackgroundHasTheLowestShareAndInterruptsNobody) {
  const SchedulingAttributes attributes = attributes_after(Scheduling::background);
  EXPECT_EQ(attributes.policy, static_cast<unsigned>(SCHED_BATCH));
  EXPECT_EQ(attributes.nice, 19);
}

TEST(Scheduling, ShortSlicesLeaveTheShareAsItIs) {
  const SchedulingAttributes before = attributes_of_this_thread(),
                             attributes = attributes_after(Scheduling::short_slices);
  EXPECT_EQ(attributes.policy, static_cast<unsigned>(SCHED_OTHER));
  EXPECT_EQ(attributes.nice, before.nice);
  if (before.runtime == 0) GTEST_SKIP() << "a kernel before 6.12 knows no slices of a thread's own";
  EXPECT_EQ(attributes.runtime, 100'000U);
}

TEST(Scheduling, WhatIsInheritedIsNotTouched) {
  const SchedulingAttributes before = attributes_of_this_thread(), attributes = attributes_after(Scheduling::inherited);
  EXPECT_EQ(attributes.policy, before.policy);
  EXPECT_EQ(attributes.nice, before.nice);
  EXPECT_EQ(attributes.runtime, before.runtime);
}

}  // namespace
}  // namespace ledgerline
