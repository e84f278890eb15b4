#include "onboard/roudi/host_check.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::roudi {
namespace {

using testing::HasSubstr;

constexpr std::uint64_t mb = 1ULL << 20;

TEST(SharedMemory, AServiceHasRoom) { EXPECT_TRUE(check_shared_memory(96 * mb, 72 * mb)); }

TEST(SharedMemory, AContainersDefaultIsTooSmallAndTheCureIsReported) {
  const Status room = check_shared_memory(64 * mb, 64 * mb);
  ASSERT_FALSE(room);
  EXPECT_THAT(room.error().message, HasSubstr("/dev/shm has 64 MB, 96 MB are needed"));
  EXPECT_THAT(room.error().message, HasSubstr("--shm-size=128m"));
}

TEST(SharedMemory, OneThatMayNotBeWrittenIsNamedWithTheCure) {
  EXPECT_TRUE(check_writable(true, false, 041777));
  EXPECT_THAT(check_writable(false, false, 040755).error().message,
              HasSubstr("may not write to /dev/shm (mode 755): as root, chmod 1777 /dev/shm"));
  EXPECT_THAT(check_writable(false, true, 041777).error().message, HasSubstr("remount,rw /dev/shm"));
}

TEST(SharedMemory, WhatOthersLeftThereMayBeTooMuch) {
  const Status room = check_shared_memory(128 * mb, 71 * mb);
  ASSERT_FALSE(room);
  EXPECT_THAT(room.error().message, HasSubstr("71 MB free of 128 MB, 72 MB are needed"));
}

}  // namespace
}  // namespace ledgerline::roudi
