#include "common/bridge/core/uplink.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <numeric>

#include "tests/unit/common/bridge/world.hpp"

namespace ledgerline::bridge {
namespace {

using namespace testing;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Kind = fabric::Outcome::Kind;

class UplinkTest : public ::testing::Test {
 protected:
  void make(std::vector<Rule> rules) { uplink.emplace(uplink_config(std::move(rules))); }
  std::size_t open(const std::string& topic, const std::string& type = "p/msg/A") {
    auto opened = uplink->open(topic, type);
    EXPECT_TRUE(opened.ok()) << opened.error().message;
    return *opened;
  }
  void add(std::size_t topic, const std::string& text) { uplink->add(++now, topic, 7, bytes(cdr(text))); }
  /// The call that goes now, if any; a minute later nothing keeps one back but what is in flight.
  std::optional<Uplink::Submit> next() {
    now += ns_per_s;
    return uplink->next(now);
  }
  void finish(const Uplink::Submit& call, Kind kind = Kind::committed, const std::string& message = {}) {
    uplink->finished(now, call.number, ended(kind, message));
  }
  const UplinkCounters& counters(std::size_t topic) { return uplink->topics()[topic].counters; }
  std::uint64_t drops(std::size_t topic, Drop why) { return counters(topic).drops.at(static_cast<std::size_t>(why)); }
  void expect_sums() {
    for (const Uplink::Topic& topic : uplink->topics()) {
      const UplinkCounters& c = topic.counters;
      EXPECT_EQ(c.taken, c.on_ledger + c.pending + std::accumulate(c.drops.begin(), c.drops.end(), std::uint64_t{0}))
          << topic.name;
    }
  }

  TimeNs now = 1000 * ns_per_s;
  std::optional<Uplink> uplink;
};

TEST_F(UplinkTest, AllTopicsOfAProcessRideInOneCall) {
  make({rule("/*")});
  const auto a = open("/a"), b = open("/tello1/b");
  add(a, "1");
  add(b, "2");
  add(a, "3");
  const auto call = next();
  ASSERT_TRUE(call);
  EXPECT_EQ(call->call.function, "set");
  EXPECT_THAT(texts(*call), ElementsAre("Org1MSP/a=1", "tello1/b=2", "Org1MSP/a=3")) << "oldest first";
  EXPECT_FALSE(next()) << "nothing waits";
  finish(*call);
  EXPECT_EQ(counters(a).on_ledger, 2U);
  EXPECT_EQ(counters(a).batches, 1U);
  EXPECT_EQ(counters(a).bytes, 10U);
  expect_sums();
}

TEST_F(UplinkTest, OriginStampAndSequenceGoAlong) {
  make({rule("/*")});
  const auto a = open("/a");
  add(a, "1");
  add(a, "2");
  const SetCall call = parsed(*next());
  EXPECT_EQ(call.assets(1).origin().writer(), writer_of(org1, ""));
  EXPECT_EQ(call.assets(1).origin().life(), 1U);
  EXPECT_EQ(call.assets(0).origin().sequence(), 1U);
  EXPECT_EQ(call.assets(1).origin().sequence(), 2U);
  EXPECT_EQ(call.assets(1).origin().stamp_ns(), 7);
}

TEST_F(UplinkTest, BetweenTwoCallsIsTheLeastGap) {
  make({rule("/*")});
  const auto a = open("/a");
  add(a, "1");
  const auto first = next();
  finish(*first);
  add(a, "2");
  EXPECT_FALSE(uplink->next(now + 9 * ns_per_ms));
  EXPECT_TRUE(uplink->next(now + 10 * ns_per_ms));
}

TEST_F(UplinkTest, OfATopicThatKeepsTheLatestOnlyTheNewestGoes) {
  Rule latest = rule("/a", 5, 1);
  latest.latest = true;
  make({latest});
  const auto a = open("/a");
  add(a, "1");
  add(a, "2");
  EXPECT_THAT(texts(*next()), ElementsAre("Org1MSP/a=2"));
  EXPECT_EQ(drops(a, Drop::replaced), 1U);
  expect_sums();
}

TEST_F(UplinkTest, BeyondItsQueueTheOldestIsDroppedAndCounted) {
  make({rule("/a", 5, 3)});
  const auto a = open("/a");
  for (const char* text : {"1", "2", "3", "4", "5"}) add(a, text);
  EXPECT_THAT(texts(*next()), ElementsAre("Org1MSP/a=3", "Org1MSP/a=4", "Org1MSP/a=5"));
  EXPECT_EQ(drops(a, Drop::overflow), 2U);
  expect_sums();
}

TEST_F(UplinkTest, AQueueIsBoundedByBytesToo) {
  make({rule("/a", 5, 1'000)});
  const auto a = open("/a");
  for (int i = 0; i < 20; ++i) add(a, std::string(900'000, 'x'));
  EXPECT_EQ(counters(a).pending, Uplink::max_queued_bytes / 900'004);
  EXPECT_EQ(drops(a, Drop::overflow), 20 - Uplink::max_queued_bytes / 900'004);
  expect_sums();
}

TEST_F(UplinkTest, AMessageAboveTheContractsLimitIsDroppedCountedAndReportedOnce) {
  make({rule("/a")});
  const auto a = open("/a");
  for (std::uint64_t count = 1; count <= 2; ++count) {
    add(a, std::string(1'000'000, 'x'));
    EXPECT_FALSE(next());
    EXPECT_EQ(drops(a, Drop::too_big), count);
    EXPECT_EQ(uplink->pop_notices().size(), count == 1 ? 1U : 0U);
  }
  uplink->record_dds_losses(a, 0, 3);
  EXPECT_THAT(uplink->pop_notices(), ElementsAre(HasSubstr("/a: a message is above 1,000,000 bytes")));
  uplink->record_dds_losses(a, 0, 4);
  EXPECT_THAT(uplink->pop_notices(), IsEmpty());
}

TEST_F(UplinkTest, TheStatusSaysWhyAWriterIsNotHeard) {
  make({rule("/a")});
  const auto a = open("/a");
  uplink->set_unheard(a, "/a is written best effort");
  EXPECT_EQ(report(*uplink)[0]["unheard"], "/a is written best effort");
  uplink->set_unheard(a, "");
  EXPECT_FALSE(report(*uplink)[0].contains("unheard"));
}

TEST_F(UplinkTest, RatesAreLimited) {
  Rule limited = rule("/a"), third = rule("/b");
  limited.rate_hz = 10;
  third.every = 3;
  make({limited, third});
  const auto a = open("/a"), b = open("/b");
  for (int i = 0; i < 100; ++i) {  // a second of 100 Hz with jitter
    now += 10 * ns_per_ms;
    uplink->add(now + (i % 3) * ns_per_ms, a, 0, bytes(cdr("")));
    uplink->add(now, b, 0, bytes(cdr("")));
  }
  EXPECT_NEAR(static_cast<double>(drops(a, Drop::rate)), 90, 1);
  EXPECT_EQ(drops(b, Drop::rate), 66U);
  expect_sums();
}

TEST_F(UplinkTest, ASourceThatKeepsTheRateLosesNothingToJitter) {
  Rule limited = rule("/a");
  limited.rate_hz = 10;
  make({limited});
  const auto a = open("/a");
  for (int i = 0; i < 100; ++i) uplink->add(now + i * 100 * ns_per_ms + (i % 2) * 20 * ns_per_ms, a, 0, bytes(cdr("")));
  EXPECT_EQ(drops(a, Drop::rate), 0U);
}

TEST_F(UplinkTest, HigherPriorityGoesFirstAndTheLowOneWaits) {
  make({rule("/joy", 9, 100), rule("/*", 1, 10'000)});
  const auto chatter = open("/chatter"), joy = open("/joy");
  for (int i = 0; i < 5'000; ++i) add(chatter, "x");
  add(joy, "1");
  const auto call = next();
  EXPECT_EQ(texts(*call).front(), "Org1MSP/joy=1");
  EXPECT_LT(parsed(*call).assets_size(), 1'000) << "the contract's limit";
  EXPECT_GT(counters(chatter).pending, 4'000U);
}

TEST_F(UplinkTest, ABigMessageGoesInACallOfItsOwnBesideTheSmallOnes) {
  make({rule("/image", 9), rule("/*", 1)});
  const auto image = open("/image"), joy = open("/joy");
  add(image, std::string(500'000, 'x'));
  add(joy, "1");
  add(image, std::string(500'000, 'y'));
  const auto small = next();
  EXPECT_FALSE(small->bulk);
  EXPECT_THAT(texts(*small), ElementsAre("Org1MSP/joy=1"));
  const auto big = next();
  ASSERT_TRUE(big);
  EXPECT_TRUE(big->bulk);
  EXPECT_EQ(parsed(*big).assets_size(), 1);
  EXPECT_FALSE(next()) << "one at a time";
  add(joy, "2");
  finish(*small);
  EXPECT_THAT(texts(*next()), ElementsAre("Org1MSP/joy=2")) << "while the big one is on its way";
  finish(*big);
  EXPECT_TRUE(next()->bulk);
  expect_sums();
}

TEST_F(UplinkTest, WhileASmallTopicOfHigherPriorityIsActiveBigMessagesLeaveTheLedgerAlone) {
  make({rule("/joy", 9), rule("/*", 1)});
  const auto image = open("/image"), joy = open("/joy"), low = open("/low");
  const auto bulk_goes = [&](TimeNs later) {
    add(joy, "1");
    now += later;
    add(joy, "2");
    add(image, std::string(20'000, 'x'));
    std::optional<Uplink::Submit> big;
    while (auto call = uplink->next(now += 10 * ns_per_ms)) {
      if (call->bulk) big = call;
      if (call->bulk) now += 20 * ns_per_ms;  // so long it is on its way
      finish(*call);
    }
    return big.has_value();
  };
  EXPECT_TRUE(bulk_goes(0)) << "the first one";
  EXPECT_FALSE(bulk_goes(2 * ns_per_s));
  EXPECT_TRUE(bulk_goes(2 * ns_per_s)) << "200 times as long as it took";
  EXPECT_FALSE(bulk_goes(0));
  now += 2 * ns_per_s;
  add(low, "1");
  finish(*uplink->next(now += 10 * ns_per_ms));
  EXPECT_TRUE(uplink->next(now += 10 * ns_per_ms)->bulk) << "the joystick is silent, and the other is no higher";
}

TEST_F(UplinkTest, BesideAProgramsOwnTrafficBigMessagesAlwaysYield) {
  auto config = uplink_config({rule("/*")});
  config.beside = true;
  uplink.emplace(config);
  const auto image = open("/image");
  const auto goes = [&] {
    const auto call = uplink->next(now += 10 * ns_per_ms);
    if (call) now += 20 * ns_per_ms;  // so long it is on its way
    if (call) finish(*call);
    return call.has_value();
  };
  add(image, std::string(20'000, 'x'));
  add(image, std::string(20'000, 'y'));
  EXPECT_TRUE(goes());
  now += 2 * ns_per_s;
  EXPECT_FALSE(goes()) << "no topic of the bridge is there that it would hold up, but commands are";
  now += 2 * ns_per_s;
  EXPECT_TRUE(goes()) << "200 times as long as it took";
}

TEST_F(UplinkTest, ATopicThatTurnsBigKeepsItsOrder) {
  make({rule("/a")});
  const auto a = open("/a");
  add(a, "1");
  const auto small = next();
  add(a, std::string(20'000, 'x'));
  EXPECT_FALSE(next()) << "the small one is not on the ledger yet";
  finish(*small);
  EXPECT_TRUE(next()->bulk);
}

TEST_F(UplinkTest, ABatchCarriesTheLastValuesOfTheOthersAlong) {
  Rule streaming = rule("/tello1/*");
  streaming.stream = true;
  make({streaming, rule("/*")});
  const auto odom = open("/tello1/odom"), imu = open("/tello1/imu"), note = open("/note");
  add(odom, "1");
  add(imu, "2");
  const auto first = next();
  EXPECT_TRUE(parsed(*first).stream());
  finish(*first);
  add(odom, "3");
  add(note, "n");
  const auto others = next(), batch = next();
  EXPECT_THAT(texts(*others), ElementsAre("Org1MSP/note=n"));
  ASSERT_THAT(texts(*batch), ElementsAre("tello1/odom=3", "tello1/imu=2"));
  EXPECT_EQ(parsed(*batch).assets(1).origin().sequence(), 1U) << "so readers know it";
  finish(*batch);
  EXPECT_EQ(counters(imu).on_ledger, 1U);
  EXPECT_EQ(counters(imu).batches, 1U);
  EXPECT_EQ(counters(odom).batches, 2U);
  expect_sums();
}

TEST_F(UplinkTest, WhatDoesNotFitTheBatchIsDroppedAndCounted) {
  Rule streaming = rule("/tello1/*");
  streaming.stream = true;
  make({streaming});
  const auto a = open("/tello1/a"), b = open("/tello1/b");
  add(a, std::string(20'000, 'x'));
  add(b, std::string(20'000, 'y'));
  add(b, "small");
  EXPECT_EQ(parsed(*next()).assets_size(), 2);
  EXPECT_EQ(drops(b, Drop::too_big), 1U);
}

TEST_F(UplinkTest, OfARefusedCallTheOthersGoAgainAndTheRefusedTopicPauses) {
  make({rule("/*")});
  const auto a = open("/a"), b = open("/tello1/b");
  add(a, "1");
  add(b, "2");
  finish(*next(), Kind::refused,
         "chaincode response 500, tello1: enrolled to Org3MSP CN=other, not to Org1MSP CN=User1");
  add(b, "3");
  now -= ns_per_s - 20 * ns_per_ms;
  EXPECT_THAT(texts(*next()), ElementsAre("Org1MSP/a=1"));
  EXPECT_EQ(drops(b, Drop::refused), 1U);
  expect_sums();
}

TEST_F(UplinkTest, AnOutsidersNameInARefusalIsNoTopics) {
  make({rule("/*")});
  const auto a = open("/a"), b = open("/tello1/b");
  add(a, "1");
  add(b, "2");
  finish(*next(), Kind::refused, "Org1MSP: the peer is not ready");
  EXPECT_EQ(drops(a, Drop::refused), 1U);
  EXPECT_EQ(drops(b, Drop::refused), 1U) << "the whole call: nothing says that it was one topic's";
  expect_sums();
}

TEST_F(UplinkTest, ARefusedTopicStaysOutForAWhile) {
  make({rule("/*")});
  const auto b = open("/tello1/b");
  add(b, "2");
  finish(*next(), Kind::refused, "chaincode response 500, tello1: not enrolled, and not your organisation (Org1MSP)");
  add(b, "3");
  EXPECT_FALSE(uplink->next(now + 999 * ns_per_ms));
  EXPECT_TRUE(uplink->next(now + 1001 * ns_per_ms));
}

TEST_F(UplinkTest, WhatDidNotGetThroughGoesAgainInItsOrder) {
  make({rule("/*")});
  const auto a = open("/a");
  add(a, "1");
  const auto first = next();
  add(a, "2");
  const auto second = next();
  ASSERT_TRUE(second) << "behind a gap";
  add(a, "3");
  finish(*second, Kind::unavailable);
  EXPECT_FALSE(next()) << "the first one may still come";
  finish(*first, Kind::unavailable);
  EXPECT_THAT(texts(*next()), ElementsAre("Org1MSP/a=1", "Org1MSP/a=2", "Org1MSP/a=3"));
  expect_sums();
}

TEST_F(UplinkTest, WhatFailedBeforeANewerOneGotThroughIsDroppedAndCounted) {
  make({rule("/*")});
  const auto a = open("/a");
  add(a, "1");
  const auto first = next();
  add(a, "2");
  const auto second = next();
  finish(*first, Kind::unavailable);
  finish(*second);
  EXPECT_FALSE(next());
  EXPECT_EQ(drops(a, Drop::unavailable), 1U);
  EXPECT_EQ(counters(a).on_ledger, 1U);
  expect_sums();
}

TEST_F(UplinkTest, ATopicThatTakesAnotherTypeLosesWhatWaitsOfTheOld) {
  make({rule("/*")});
  const auto a = open("/a");
  add(a, "1");
  EXPECT_EQ(open("/a", "p/msg/B"), a);
  add(a, "2");
  const auto call = next();
  EXPECT_THAT(texts(*call), ElementsAre("Org1MSP/a=2"));
  EXPECT_EQ(parsed(*call).assets(0).msg_type(), "p/msg/B");
  EXPECT_EQ(drops(a, Drop::type_changed), 1U);
  expect_sums();
}

TEST_F(UplinkTest, TopicsThatNoRuleWantsOrOfAnotherTypeOrTooManyAreRefused) {
  Rule typed = rule("/typed");
  typed.type = "p/msg/A";
  Rule down = rule("/down");
  down.to_ledger = false;
  make({typed, down, rule("/some/*")});
  EXPECT_THAT(uplink->open("/typed", "p/msg/B").error().message,
              HasSubstr("its type is p/msg/B, its [[topic]] says p/msg/A"));
  EXPECT_FALSE(uplink->open("/down", "p/msg/A").ok());
  EXPECT_FALSE(uplink->open("/other", "p/msg/A").ok());
  EXPECT_FALSE(uplink->open("/some/x", "no type").ok());
  for (std::size_t i = 0; i < Uplink::max_topics; ++i) open("/some/" + std::to_string(i));
  EXPECT_THAT(uplink->open("/some/more", "p/msg/A").error().message, HasSubstr("256 topics are carried already"));
  open("/some/7");
}

}  // namespace
}  // namespace ledgerline::bridge
