#include "chaincode/node/core/ordering/waiting.hpp"

#include <gmock/gmock.h>

#include <algorithm>

namespace ledgerline::node {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class WaitingTest : public ::testing::Test {
 protected:
  std::optional<std::string> add(const std::string& who, std::string envelope, Urgency urgency = Urgency::none) {
    return add_of("Org1MSP", who, std::move(envelope), urgency);
  }
  std::optional<std::string> add_of(const std::string& msp_id, const std::string& who, std::string envelope,
                                    Urgency urgency = Urgency::none) {
    return waiting.add({{msp_id, who}, urgency}, std::move(envelope), now_ns);
  }
  /// As they leave, each in a block of its own.
  std::vector<std::string> all() {
    std::vector<std::string> left;
    while (!waiting.empty()) left.push_back(waiting.pop(1, 1).at(0));
    return left;
  }

  CoreConfig config;
  Waiting waiting{config};
  TimeNs now_ns = ns_per_s;
};

TEST_F(WaitingTest, OfOneIdentityTheOldestIsFirst) {
  for (const char* envelope : {"a", "b", "c"}) EXPECT_EQ(add("one", envelope), std::nullopt);
  EXPECT_THAT(waiting.pop(2, 100), ElementsAre("a", "b"));
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
      const auto one = waiting.pop(1, 1'000);
      ASSERT_EQ(one.size(), 1U);
      worst = std::max(worst, before);
      if (one[0][0] == 'p') break;
    }
  }
  EXPECT_LE(worst, 1);
}

TEST_F(WaitingTest, UrgentOnesLeaveFirstAndStopsBeforeThem) {
  add("one", "state");
  add("one", std::string(1'000, 'c'), Urgency::control);
  add("two", "acquire", Urgency::control);
  add("one", "clear_stop", Urgency::control);
  add("two", "stop", Urgency::stop);
  EXPECT_THAT(all(), ElementsAre("stop", std::string(1'000, 'c'), "acquire", "clear_stop", "state"))
      << "each in its turn";
}

TEST_F(WaitingTest, OfFiveThatLeaveOneIsNotUrgent) {
  for (int i = 0; i < 20; ++i) {
    add("one", "command", i % 2 == 0 ? Urgency::control : Urgency::stop);
    add("two", "state");
  }
  const auto taken = all();
  EXPECT_EQ(std::count(taken.begin(), taken.begin() + 20, "state"), 4);
  EXPECT_EQ(taken[4], "state");
}

TEST_F(WaitingTest, WithinABlockTheyAreInTheOrderInWhichTheyCame) {
  add("one", "state");
  add("two", "acquire", Urgency::control);
  add("one", "stop", Urgency::stop);
  add("two", "later");
  EXPECT_THAT(waiting.pop(3, 1'000), ElementsAre("state", "acquire", "stop"));
}

TEST_F(WaitingTest, AQuarterOfThePlacesIsKeptForUrgentOnes) {
  config.max_waiting = 100;
  int taken = 0;
  for (int who = 0; who < 30; ++who) {
    for (int i = 0; i < 20; ++i) taken += !add_of("Org" + std::to_string(who % 3) + "MSP", std::to_string(who), "x");
  }
  EXPECT_EQ(taken, 75);
  EXPECT_THAT(add("other", "x").value_or(""), HasSubstr("75 envelopes wait"));
  EXPECT_EQ(add("other", "stop", Urgency::stop), std::nullopt);
}

TEST_F(WaitingTest, AnOrganisationFillsHalfOfTheRestHoweverManyIdentitiesItHas) {
  config.max_waiting = 1'600;
  int taken = 0;
  for (int i = 0; i < 2'000; ++i) taken += !add_of("Org3MSP", "sybil" + std::to_string(i), "x");
  EXPECT_EQ(taken, 600);
  EXPECT_THAT(add_of("Org3MSP", "one more", "x").value_or(""), HasSubstr("600 envelopes of Org3MSP wait"));
  EXPECT_EQ(add_of("Org1MSP", "host", "x"), std::nullopt);
  for (int i = 0; i < 2'000; ++i) add_of("Org3MSP", "sybil" + std::to_string(i), "x", Urgency::control);
  EXPECT_EQ(add_of("Org1MSP", "pilot", "x", Urgency::control), std::nullopt);
}

TEST_F(WaitingTest, AnOrganisationThatMintsIdentitiesLeavesNoFasterByThem) {
  for (int i = 0; i < 500; ++i) {
    add_of("Org3MSP", "sybil" + std::to_string(i), std::string(500, 's'));
    add_of("Org3MSP", "sybil" + std::to_string(i), std::string(500, 's'), Urgency::control);
  }
  for (const Urgency urgency : {Urgency::control, Urgency::none}) {
    add_of("Org1MSP", "host", std::string(500, 'h'), urgency);
    int before = 0;
    while (waiting.pop(1, 1'000).at(0)[0] != 'h') ++before;
    EXPECT_LE(before, urgency == Urgency::control ? 2 : 10) << "one of the other organisation, in its lane";
  }
}

TEST_F(WaitingTest, OneIdentityFillsAQuarterAndNoMore) {
  config.max_waiting = 100;
  int taken = 0;
  for (int i = 0; i < 100; ++i) taken += !add("one", "x");
  EXPECT_EQ(taken, 25);
  for (int i = 0; i < 100; ++i) taken += !add("one", "stop", Urgency::stop);
  EXPECT_EQ(taken, 25 + 6) << "a sixteenth";
  EXPECT_THAT(add("one", "x").value_or(""), HasSubstr("of this identity"));
  EXPECT_EQ(add("two", "x"), std::nullopt);
}

TEST_F(WaitingTest, TheSameHoldsForBytesButOneAloneIsAlwaysTaken) {
  config.max_waiting_bytes = 1'000;
  EXPECT_EQ(add("one", std::string(900, 'x')), std::nullopt);
  EXPECT_NE(add("one", "x"), std::nullopt);
  EXPECT_NE(add("two", "x"), std::nullopt);
  EXPECT_EQ(add("two", "x", Urgency::control), std::nullopt);
}

TEST_F(WaitingTest, WhoHasSpentItsAllowanceGetsItBackWithTime) {
  config.identity_bytes_per_s = 1'000;
  config.identity_burst_bytes = 3'000;
  for (int i = 0; i < 3; ++i) EXPECT_EQ(add("one", std::string(1'000, 'x')), std::nullopt);
  all();
  EXPECT_THAT(add("one", std::string(1'000, 'x')).value_or(""), HasSubstr("may send"));
  EXPECT_EQ(add("two", std::string(1'000, 'x')), std::nullopt);
  EXPECT_EQ(add("one", "stop", Urgency::stop), std::nullopt) << "what is urgent is not held back for it";
  now_ns += ns_per_s + 10 * ns_per_ms;
  EXPECT_EQ(add("one", std::string(1'000, 'x')), std::nullopt);
  EXPECT_NE(add("one", std::string(1'000, 'x')), std::nullopt);
}

TEST_F(WaitingTest, OneLargerThanTheAllowanceIsTakenFromWhoHasSpentNothing) {
  config.identity_burst_bytes = 10;
  EXPECT_EQ(add("one", std::string(1'000, 'x')), std::nullopt);
}

TEST_F(WaitingTest, TheOldestIsKnownWhicheverEntryLeaves) {
  add("one", "a");
  now_ns += 5;
  add("one", "b", Urgency::control);
  EXPECT_EQ(waiting.oldest_ns(), ns_per_s);
  EXPECT_THAT(waiting.pop(1, 100), ElementsAre("b"));
  EXPECT_EQ(waiting.oldest_ns(), ns_per_s);
  EXPECT_THAT(waiting.pop(1, 100), ElementsAre("a"));
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
