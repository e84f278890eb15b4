#include "chaincode/node/core/ordering/waiting.hpp"

#include <gmock/gmock.h>

namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class WaitingTest : public ::testing::Test {
 protected:
  std::optional<std::string> add(const std::string& who, std::string envelope, bool urgent = false) {
    return waiting.add({{"Org1MSP", who}, urgent}, std::move(envelope), now_ns);
  }
  std::vector<std::string> all() { return waiting.take(1'000, 1'000'000'000); }

  CoreConfig config;
  Waiting waiting{config};
  TimeNs now_ns = ns_per_s;
};

TEST_F(WaitingTest, OfOneIdentityTheOldestIsFirst) {
  for (const char* envelope : {"a", "b", "c"}) EXPECT_EQ(add("one", envelope), std::nullopt);
  EXPECT_THAT(waiting.take(2, 100), ElementsAre("a", "b"));
  EXPECT_THAT(all(), ElementsAre("c"));
  EXPECT_TRUE(waiting.empty());
}

TEST_F(WaitingTest, WhoSendsMuchWaitsBehindWhoSendsLittle) {
  for (int i = 0; i < 5; ++i) add("much", std::string(1'000, static_cast<char>('0' + i)));
  add("little", "l");
  const auto taken = all();
  ASSERT_EQ(taken.size(), 6U);
  EXPECT_EQ(taken[0][0], '0') << "it came first, when nothing else waited";
  EXPECT_EQ(taken[1], "l");
}

TEST_F(WaitingTest, AFloodDelaysEachEnvelopeOfAnotherByOneOfItsOwnAtMost) {
  for (int i = 0; i < 1'000; ++i) add("flood", std::string(500, 'f'));
  int worst = 0;
  for (int i = 0; i < 100; ++i) {
    add("pilot", std::string(500, 'p'));
    for (int before = 0;; ++before) {
      const auto one = waiting.take(1, 1'000);
      ASSERT_EQ(one.size(), 1U);
      worst = std::max(worst, before);
      if (one[0][0] == 'p') break;
    }
  }
  EXPECT_LE(worst, 1);
}

TEST_F(WaitingTest, UrgentOnesLeaveFirst) {
  add("one", "state");
  add("one", std::string(1'000, 'c'), true);
  add("two", "stop", true);
  add("one", "resume", true);
  EXPECT_THAT(all(), ElementsAre(std::string(1'000, 'c'), "stop", "resume", "state")) << "each in its turn";
}

TEST_F(WaitingTest, AQuarterOfThePlacesIsKeptForUrgentOnes) {
  config.max_waiting = 100;
  int taken = 0;
  for (int who = 0; who < 20; ++who) {
    for (int i = 0; i < 20; ++i) taken += !add("member" + std::to_string(who), "x");
  }
  EXPECT_EQ(taken, 75);
  EXPECT_THAT(add("other", "x").value_or(""), HasSubstr("75 envelopes wait"));
  EXPECT_EQ(add("other", "stop", true), std::nullopt);
}

TEST_F(WaitingTest, OneIdentityFillsAQuarterAndNoMore) {
  config.max_waiting = 100;
  int taken = 0;
  for (int i = 0; i < 100; ++i) taken += !add("one", "x");
  EXPECT_EQ(taken, 25);
  for (int i = 0; i < 100; ++i) taken += !add("one", "stop", true);
  EXPECT_EQ(taken, 25 + 6) << "a sixteenth";
  EXPECT_THAT(add("one", "x").value_or(""), HasSubstr("of this identity"));
  EXPECT_EQ(add("two", "x"), std::nullopt);
}

TEST_F(WaitingTest, TheSameHoldsForBytesButOneAloneIsAlwaysTaken) {
  config.max_waiting_bytes = 1'000;
  EXPECT_EQ(add("one", std::string(900, 'x')), std::nullopt);
  EXPECT_NE(add("one", "x"), std::nullopt);
  EXPECT_NE(add("two", "x"), std::nullopt);
  EXPECT_EQ(add("two", "x", true), std::nullopt);
}

TEST_F(WaitingTest, WhoHasSpentItsAllowanceGetsItBackWithTime) {
  config.identity_bytes_per_s = 1'000;
  config.identity_burst_bytes = 3'000;
  for (int i = 0; i < 3; ++i) EXPECT_EQ(add("one", std::string(1'000, 'x')), std::nullopt);
  all();
  EXPECT_THAT(add("one", std::string(1'000, 'x')).value_or(""), HasSubstr("may send"));
  EXPECT_EQ(add("two", std::string(1'000, 'x')), std::nullopt);
  EXPECT_EQ(add("one", "stop", true), std::nullopt) << "what is urgent is not held back for it";
  now_ns += ns_per_s + 10 * ns_per_ms;
  EXPECT_EQ(add("one", std::string(1'000, 'x')), std::nullopt);
  EXPECT_NE(add("one", std::string(1'000, 'x')), std::nullopt);
}

TEST_F(WaitingTest, OneLargerThanTheAllowanceIsTakenFromWhoHasSpentNothing) {
  config.identity_burst_bytes = 10;
  EXPECT_EQ(add("one", std::string(1'000, 'x')), std::nullopt);
}

TEST_F(WaitingTest, TheOldestIsKnownWhoeverLeaves) {
  add("one", "a");
  now_ns += 5;
  add("one", "b", true);
  EXPECT_EQ(waiting.oldest_ns(), ns_per_s);
  EXPECT_THAT(waiting.take(1, 100), ElementsAre("b"));
  EXPECT_EQ(waiting.oldest_ns(), ns_per_s);
  EXPECT_THAT(waiting.take(1, 100), ElementsAre("a"));
  EXPECT_TRUE(waiting.empty());
  EXPECT_EQ(waiting.bytes(), 0U);
}

TEST_F(WaitingTest, WhatALotOfIdentitiesLeaveBehindIsForgotten) {
  for (int who = 0; who < 100'000; ++who) {
    now_ns += ns_per_ms;
    ASSERT_EQ(add(std::to_string(who), "x"), std::nullopt);
    all();
  }
  EXPECT_LE(waiting.remembered(), 1'025U);
}

}  // namespace
}  // namespace ledgerline::node
