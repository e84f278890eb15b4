#include "onboard/roudi/host_check.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/sysmacros.h>
#include <unistd.h>

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

UserGroup plain_group() {
  return {.user = 1000, .group = 1001, .user_name = "joe", .group_name = "pilots", .is_member = true};
}

TEST(RoudisGroup, NeedsEntriesAndAPlainNameAndIsNamedWithTheCure) {
  EXPECT_TRUE(check_group(plain_group()));
  const auto why = [](auto spoil) {
    UserGroup of = plain_group();
    spoil(of);
    const Status checked = check_group(of);
    return checked ? std::string() : checked.error().message;
  };
  EXPECT_THAT(why([](UserGroup& of) { of.user_name.clear(); }), HasSubstr("user 1000 has no entry in /etc/passwd"));
  EXPECT_THAT(why([](UserGroup& of) { of.group_name.clear(); }), HasSubstr("groupadd --gid 1001 NAME"));
  for (const char* name : {"domain users", "users@example.org", "AD\\users", "ends.", "größe"})
    EXPECT_THAT(why([&](UserGroup& of) { of.group_name = name; }), HasSubstr("sg GROUP")) << name;
  EXPECT_THAT(why([](UserGroup& of) { of.group_name = std::string(101, 'g'); }), HasSubstr("does not take"));
  EXPECT_THAT(why([](UserGroup& of) { of.is_member = false; }), HasSubstr("gpasswd -a joe pilots"));
  EXPECT_EQ(why([](UserGroup& of) { of.group_name = "a-b.c:d_1"; }), "");
}

TEST(RoudisGroup, WarnsOfOthersWhoMayWriteItsMemory) {
  UserGroup of = plain_group();
  EXPECT_EQ(warn_of_others(of), "");
  of.others = {"u1", "u2"};
  EXPECT_THAT(warn_of_others(of), HasSubstr("group pilots has other users (u1, u2), who may write"));
  of.others = {"a", "b", "c", "d", "e", "f", "g"};
  EXPECT_THAT(warn_of_others(of), HasSubstr("(a, b, c, d, e and 2 more)"));
}

TEST(RoudisGroup, OfThisProcessIsTheSystemsOwn) {
  const UserGroup of = group_of_process();
  EXPECT_EQ(of.user, ::geteuid());
  EXPECT_EQ(of.group, ::getegid());
  EXPECT_THAT(of.others, testing::Not(testing::Contains(of.user_name)));
}

TEST(OtherRoudi, WhatADeadOneOfAnotherUserLeftIsNoLivingOne) {
  EXPECT_THAT(in_the_way(false, std::nullopt, "").message, HasSubstr("rm /tmp/roudi"));
}

}  // namespace
}  // namespace ledgerline::roudi
