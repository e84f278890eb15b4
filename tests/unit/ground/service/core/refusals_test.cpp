#include "ground/service/core/board.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::ground::service {
namespace {

using fabric::Outcome;
using testing::HasSubstr;

Outcome refused(const std::string& words) {
  return Outcome::failed(Outcome::Kind::refused, "chaincode response 500, " + words);
}

TEST(Refusals, SayTheContractsWordsOfTheDroneThatTheyAreAbout) {
  Refusals refusals({"tello1", "tello2"});
  refusals.add("command", refused("tello2: held by somebody else"));
  const auto said = refusals.pop_due(0);
  ASSERT_EQ(said.size(), 1U);
  EXPECT_EQ(said[0].drone, "tello2");
  EXPECT_EQ(said[0].text, "command refused: tello2: held by somebody else");
  EXPECT_TRUE(refusals.pop_due(10 * ns_per_s).empty()) << "once";
}

TEST(Refusals, AStormIsReportedOnceASecondWithItsCount) {
  Refusals refusals({"tello1"});
  std::size_t events = 0;
  for (TimeNs now = 0; now < 10 * ns_per_s; now += ns_per_ms) {
    refusals.add("command", refused("tello1: no"));
    events += refusals.pop_due(now).size();
  }
  EXPECT_EQ(events, 10U);
  const auto last = refusals.pop_due(10 * ns_per_s);
  ASSERT_EQ(last.size(), 1U) << "the rest is not lost";
  EXPECT_THAT(last[0].text, HasSubstr("(999 times)"));
}

TEST(Refusals, DronesAndKindsDoNotHoldEachOtherBack) {
  Refusals refusals({"tello1", "tello2"});
  refusals.add("command", refused("tello1: no"));
  refusals.add("command", refused("tello2: no"));
  refusals.add("command", refused("somebody-else: no"));
  Outcome invalid;
  invalid.kind = Outcome::Kind::invalidated;
  invalid.block = 12;
  invalid.code = 11;
  refusals.add("command", invalid);
  const auto said = refusals.pop_due(0);
  ASSERT_EQ(said.size(), 4U);
  EXPECT_EQ(said[0].drone, "");
  EXPECT_THAT(said[0].text, HasSubstr("invalid in block 12 (code 11)"));
}

TEST(Refusals, WhatIsCommittedIsNothingToSayAndWhatAPeerSaysIsBounded) {
  Refusals refusals({"tello1"});
  Outcome committed;
  committed.kind = Outcome::Kind::committed;
  refusals.add("command", committed);
  EXPECT_TRUE(refusals.pop_due(0).empty());
  refusals.add("stop", Outcome::failed(Outcome::Kind::unavailable, std::string(100'000, '\n')));
  EXPECT_LT(refusals.pop_due(0).at(0).text.size(), 2'000U);
}

TEST(Notices, ARequestThatIsRepeatedIsReportedOnceASecondAndAnotherAtOnce) {
  Notices<std::string> requests;
  const auto request = [&](const std::string& words) { requests.add("tello1", words, words); };
  request("land, asked for by alice");
  EXPECT_EQ(requests.pop_due(0).at(0).text, "land, asked for by alice");
  for (int i = 0; i < 3; ++i) request("land, asked for by alice");
  request("land, asked for by bob");
  const auto other = requests.pop_due(ns_per_ms);
  ASSERT_EQ(other.size(), 1U);
  EXPECT_EQ(other[0].text, "land, asked for by bob");
  EXPECT_EQ(requests.pop_due(ns_per_s).at(0).text, "land, asked for by alice (3 times)");
}

}  // namespace
}  // namespace ledgerline::ground::service
