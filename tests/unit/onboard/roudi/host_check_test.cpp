#include "onboard/roudi/host_check.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/sysmacros.h>

namespace ledgerline::roudi {
namespace {

using testing::HasSubstr;

constexpr const char* locks =
    "1: POSIX  ADVISORY  WRITE 77 fe:00:3 0 EOF\n"
    "2: FLOCK  ADVISORY  WRITE 30942 00:28:3 0 EOF\n"
    "2: -> FLOCK  ADVISORY  WRITE 30950 00:28:3 0 EOF\n"
    "3: FLOCK  ADVISORY  WRITE 0 00:28:9 0 EOF\n";

TEST(OtherRoudi, TheProcessIsTheOneThatHoldsTheLockOnThatFile) {
  EXPECT_EQ(lock_holder(locks, makedev(0, 0x28), 3), 30942);
  EXPECT_EQ(lock_holder(locks, makedev(0xfe, 0), 3), 77);
}

TEST(OtherRoudi, WhoWaitsForALockOrIsOfAnotherContainerIsNobody) {
  EXPECT_EQ(lock_holder(locks, makedev(0, 0x28), 4), std::nullopt);
  EXPECT_EQ(lock_holder(locks, makedev(0, 0x28), 9), std::nullopt);
  EXPECT_EQ(lock_holder("", 0, 0), std::nullopt);
  EXPECT_EQ(lock_holder("torn line", 0, 0), std::nullopt);
}

TEST(OtherRoudi, OneThatLivesIsNamedWithTheCure) {
  const std::string what = in_the_way(true, 123, "iox-roudi").message;
  EXPECT_THAT(what, HasSubstr("iox-roudi (process 123)"));
  EXPECT_THAT(what, HasSubstr("kill 123"));
  EXPECT_THAT(what, HasSubstr("a container with /tmp and /dev/shm of its own"));
  EXPECT_EQ(in_the_way(false, 123, "iox-roudi").message, what) << "its user does not matter";
  EXPECT_THAT(in_the_way(true, std::nullopt, "").message, HasSubstr("pgrep -af roudi"));
}

TEST(OtherRoudi, WhatADeadOneOfAnotherUserLeftIsNoLivingOne) {
  EXPECT_THAT(in_the_way(false, std::nullopt, "").message, HasSubstr("rm /tmp/roudi"));
}

}  // namespace
}  // namespace ledgerline::roudi
