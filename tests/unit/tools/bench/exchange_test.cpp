#include "tools/bench/exchange.hpp"

#include <gmock/gmock.h>

namespace ledgerline::bench {
namespace {

using testing::ElementsAre;

/// Messages 2 to 5 are measured.
Schedule small(int streams) { return {.streams = streams, .fast_per_s = 10, .per_s = 10, .first = 2, .count = 4}; }

TEST(Schedule, RateIsOfBothDirectionsTogether) {
  const Schedule s = make_schedule(70, 10, 20, 5);
  EXPECT_EQ(s.per_s, 35);
  EXPECT_EQ(s.count, 20u * 35);
  EXPECT_EQ(s.due_ns(s.first + 35) - s.due_ns(s.first), ns_per_s);
}

TEST(Schedule, WarmUpLastsAsLongAsAskedAndTakesSeventyAtLeast) {
  const Schedule slow = make_schedule(30, 10, 20, 5);
  EXPECT_EQ(slow.fast_count, 8u * 35);
  EXPECT_EQ(slow.first, 8u * 35 + 2 * 15);
  EXPECT_EQ(slow.due_ns(slow.first), 10 * ns_per_s);
  const Schedule fast = make_schedule(250, 10, 20, 5);
  EXPECT_EQ(fast.fast_per_s, 125);
  EXPECT_EQ(fast.due_ns(fast.first), 10 * ns_per_s);
  EXPECT_DOUBLE_EQ(fast.length_s(), 10 + 20 + 5);
}

TEST(Schedule, MessagesAreEvenAlsoWhereTheRateChanges) {
  const Schedule s = make_schedule(30, 4, 2, 5);
  for (std::uint64_t n = 0; n + 1 < s.first + s.count; ++n) {
    const TimeNs gap = s.due_ns(n + 1) - s.due_ns(n);
    EXPECT_NEAR(to_ms(gap), n < s.fast_count ? 1000.0 / 35 : 1000.0 / 15, 0.001) << n;
  }
}

TEST(Schedule, AStreamIsADroneOfAtMost35Hz) {
  EXPECT_EQ(make_schedule(30, 1, 1, 1).streams, 1);
  EXPECT_EQ(make_schedule(70, 1, 1, 1).streams, 1);
  EXPECT_EQ(make_schedule(110, 1, 1, 1).streams, 2);
  EXPECT_EQ(make_schedule(1000, 1, 1, 1).streams, 15);
}

TEST(Schedule, ComesBackFromItsText) {
  const Schedule s = make_schedule(250, 3.5, 20, 5);
  const auto read = read_schedule(write_schedule(s));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->streams, s.streams);
  EXPECT_EQ(read->first, s.first);
  EXPECT_EQ(read->count, s.count);
  for (const std::uint64_t n : {0, 100, 1000, 5000}) EXPECT_EQ(read->due_ns(n), s.due_ns(n));
}

TEST(Schedule, NonsenseIsRefused) {
  EXPECT_FALSE(read_schedule(""));
  EXPECT_FALSE(read_schedule("[]"));
  EXPECT_FALSE(read_schedule("{\"streams\":1}"));
  Schedule s = make_schedule(70, 1, 1, 1);
  s.streams = 0;
  EXPECT_FALSE(read_schedule(write_schedule(s)));
  s = make_schedule(70, 1, 1, 1);
  s.per_s = 0;
  EXPECT_FALSE(read_schedule(write_schedule(s)));
}

TEST(Account, OnlyMessagesOfTheMeasuredTimeCount) {
  Account account(small(1), false);
  for (std::uint64_t n = 0; n < 8; ++n) {
    account.sent(static_cast<TimeNs>(100 * n), n);
    EXPECT_TRUE(account.answered(static_cast<TimeNs>(100 * n + n), n, static_cast<TimeNs>(100 * n)));
  }
  EXPECT_EQ(account.sent(), 4u);
  EXPECT_EQ(account.answered(), 4u);
  EXPECT_EQ(account.answers(), 8u);
  EXPECT_THAT(account.times(), ElementsAre(2, 3, 4, 5));
}

TEST(Account, AnAnswerCountsOnceAndOnlyWithItsStamp) {
  Account account(small(1), false);
  for (std::uint64_t n = 0; n < 3; ++n) account.sent(100, n);
  EXPECT_FALSE(account.answered(200, 2, 99));
  EXPECT_TRUE(account.answered(200, 2, 100));
  EXPECT_FALSE(account.answered(300, 2, 100));
  EXPECT_FALSE(account.answered(300, 7, 100));
  EXPECT_EQ(account.answered(), 1u);
  EXPECT_THAT(account.times(), ElementsAre(100));
}

TEST(Account, ANewerAnswerReplacesOlderMessagesOfItsStreamAlone) {
  Account account(small(2), true);
  for (std::uint64_t n = 0; n < 7; ++n) account.sent(static_cast<TimeNs>(10 * n), n);
  EXPECT_TRUE(account.answered(100, 4, 40));  // 2 is of the same stream, 3 and 5 are not
  EXPECT_EQ(account.replaced(), 1u);
  EXPECT_EQ(account.answered(), 1u);
  EXPECT_THAT(account.times(), ElementsAre(60, 80));
  EXPECT_FALSE(account.answered(110, 2, 20)) << "it has been given up";
  EXPECT_FALSE(account.complete());
  EXPECT_TRUE(account.answered(110, 3, 30));
  EXPECT_TRUE(account.answered(120, 5, 50));
  EXPECT_TRUE(account.complete());
}

TEST(Account, WhereAnswersMayOvertakeNothingIsReplaced) {
  Account account(small(1), false);
  for (std::uint64_t n = 0; n < 7; ++n) account.sent(0, n);
  for (const std::uint64_t n : {5, 4, 3, 2}) EXPECT_TRUE(account.answered(1, n, 0));
  EXPECT_EQ(account.answered(), 4u);
  EXPECT_EQ(account.replaced(), 0u);
}

TEST(Account, IsCompleteOnlyWhenTheMeasuredTimeIsOver) {
  Account account(small(1), false);
  for (std::uint64_t n = 0; n < 6; ++n) {
    account.sent(0, n);
    account.answered(1, n, 0);
  }
  EXPECT_FALSE(account.complete());
  account.sent(2, 6);
  EXPECT_TRUE(account.complete());
}

TEST(Account, WhatIsNeverAnsweredCountsWithTheTimeThatItWaited) {
  Account account(small(1), false);
  for (std::uint64_t n = 0; n < 7; ++n) account.sent(0, n);
  account.answered(10, 2, 0);
  account.end(1000);
  EXPECT_EQ(account.sent(), 4u);
  EXPECT_EQ(account.answered(), 1u);
  EXPECT_THAT(account.times(), ElementsAre(10, 1000, 1000, 1000));
}

TEST(Message, HasThePublishedLayoutAndAbout500Bytes) {
  const std::string text = write_message({1234, 5'000'000'678}, "/odom");
  EXPECT_GT(text.size(), 450u);
  EXPECT_LT(text.size(), 600u);
  EXPECT_TRUE(text.starts_with(R"({"topic":"/odom","msg_type":"nav_msgs/msg/Odometry","msg":{)"));
  Message back;
  ASSERT_TRUE(read_message(text, back));
  EXPECT_EQ(back.n, 1234u);
  EXPECT_EQ(back.stamp_ns, 5'000'000'678);
}

TEST(Message, WhatIsNoMessageIsRefused) {
  Message message;
  for (const char* text : {"", "{", "[]", "{}", R"({"msg":1})", R"({"msg":{"header":{}}})",
                           R"({"msg":{"header":{"seq":1}}})", R"({"msg":{"header":{"seq":1,"stamp":2}}})",
                           R"({"msg":{"header":{"seq":-1,"stamp":{"sec":1,"nanosec":1}}}})"}) {
    EXPECT_FALSE(read_message(text, message)) << text;
  }
}

}  // namespace
}  // namespace ledgerline::bench
