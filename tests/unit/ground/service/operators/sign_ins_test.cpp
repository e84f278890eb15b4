#include "ground/service/operators/sign_ins.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/access/access.hpp"
#include "common/msg/contract.hpp"
#include "ground/service/operators/calls.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground::service {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr TimeNs idle_ns = 60 * ns_per_s;

TEST(SignIns, ASessionIsKnownByItsTokenAndLivesWhileItIsHeardOf) {
  SignIns sign_ins(2, idle_ns);
  sign_ins.begin(0, 1, "secret");
  ASSERT_TRUE(sign_ins.of(1, "secret"));
  EXPECT_EQ(sign_ins.of(1, "secret")->who, 1U);
  EXPECT_FALSE(sign_ins.of(1, "guessed"));
  EXPECT_FALSE(sign_ins.of(1, ""));
  const auto session = *sign_ins.of(50 * ns_per_s, "secret");
  EXPECT_TRUE(sign_ins.touch(100 * ns_per_s, session));
  EXPECT_THAT(sign_ins.expire(100 * ns_per_s), IsEmpty());
  EXPECT_FALSE(sign_ins.of(161 * ns_per_s, "secret")) << "nothing was heard for a minute";
  EXPECT_THAT(sign_ins.expire(161 * ns_per_s), ElementsAre(1U));
  EXPECT_THAT(sign_ins.expire(161 * ns_per_s), IsEmpty()) << "said once";
}

TEST(SignIns, ANewSessionAndASignOutEndTheOneBefore) {
  SignIns sign_ins(1, idle_ns);
  sign_ins.begin(0, 0, "first");
  const auto first = *sign_ins.of(0, "first");
  sign_ins.begin(1, 0, "second");
  EXPECT_FALSE(sign_ins.of(1, "first"));
  EXPECT_FALSE(sign_ins.touch(1, first));
  sign_ins.end(first);
  EXPECT_TRUE(sign_ins.of(1, "second")) << "another session's end is not its";
  sign_ins.end(*sign_ins.of(1, "second"));
  EXPECT_FALSE(sign_ins.of(1, "second"));
}

TEST(SignIns, WhatWasASessionIsKnownHoweverItEnded) {
  SignIns sign_ins(2, idle_ns);
  sign_ins.begin(0, 0, "replaced");
  EXPECT_FALSE(sign_ins.is_over(1, "replaced"));
  sign_ins.begin(1, 0, "signed out");
  EXPECT_TRUE(sign_ins.is_over(1, "replaced"));
  sign_ins.end(*sign_ins.of(1, "signed out"));
  EXPECT_TRUE(sign_ins.is_over(1, "signed out"));
  sign_ins.begin(1, 1, "idle");
  EXPECT_TRUE(sign_ins.is_over(1 + idle_ns + 1, "idle")) << "at once, before it is looked for";
  sign_ins.expire(1 + idle_ns + 1);
  EXPECT_TRUE(sign_ins.is_over(1 + idle_ns + 1, "idle"));
  EXPECT_FALSE(sign_ins.is_over(1, "guessed"));
  EXPECT_FALSE(sign_ins.is_over(1, ""));
}

TEST(SignIns, OfTheEndedTheNewestAreRemembered) {
  SignIns sign_ins(1, idle_ns);
  for (std::size_t i = 0; i <= SignIns::max_ended + 1; ++i) sign_ins.begin(0, 0, std::to_string(i));
  EXPECT_FALSE(sign_ins.is_over(0, "0"));
  EXPECT_TRUE(sign_ins.is_over(0, "1"));
  EXPECT_TRUE(sign_ins.is_over(0, std::to_string(SignIns::max_ended)));
  EXPECT_FALSE(sign_ins.is_over(0, std::to_string(SignIns::max_ended + 1))) << "that one is signed in";
}

TEST(SignIns, WhoIsDismissedLosesHisSessionAndBeginsNone) {
  SignIns sign_ins(2, idle_ns);
  sign_ins.begin(0, 0, "alice's");
  sign_ins.begin(0, 1, "bob's");
  EXPECT_THAT(sign_ins.dismiss({1}), ElementsAre(1U));
  EXPECT_FALSE(sign_ins.of(1, "bob's"));
  EXPECT_TRUE(sign_ins.is_over(1, "bob's")) << "it still stops and lands";
  EXPECT_TRUE(sign_ins.of(1, "alice's"));
  EXPECT_TRUE(sign_ins.is_dismissed(1));
  EXPECT_THAT(sign_ins.dismiss({1}), IsEmpty()) << "said once";
  EXPECT_THAT(sign_ins.dismiss({}), IsEmpty());
  EXPECT_FALSE(sign_ins.is_dismissed(1)) << "his role was given back";
}

TEST(SignIns, DismissedAreThoseWhoseRoleIsAnotherThanAnOperators) {
  const auto one = [](const char* name) { return Operator{name, {"Org2MSP", std::string("CN=") + name}}; };
  const std::vector<Operator> operators{one("alice"), one("bob"), one("carol"), one("dave"), one("eve")};
  verification::RolesByOrganisation roles;
  const Role given[] = {OPERATOR, REVOKED, SUPERVISOR, AUDITOR};
  for (std::size_t i = 0; i < std::size(given); ++i) roles.apply({to_message(operators[i].identity), given[i]});
  EXPECT_THAT(dismissed(operators, roles), ElementsAre(1U, 3U));
}

TEST(Attempts, FiveOfAnAddressAreLookedAtAtOnceAndThenOneInEachPause) {
  Attempts attempts;
  for (int i = 0; i < Attempts::free_of_address; ++i) {
    EXPECT_EQ(attempts.next_attempt(i, "here"), i);
    attempts.failed("here");
  }
  EXPECT_EQ(attempts.next_attempt(10, "here"), 10 + Attempts::pause_ns);
  EXPECT_FALSE(attempts.next_attempt(11, "here")) << "one at a time";
  EXPECT_EQ(attempts.next_attempt(11, "elsewhere"), 11) << "nobody is locked out by another address";
  EXPECT_TRUE(attempts.next_attempt(10 + Attempts::pause_ns, "here"));
}

TEST(Attempts, FromHoweverManyAddressesGuessingIsSlow) {
  Attempts attempts;
  TimeNs now = 0;
  int at_once = 0, later = 0;
  for (int i = 0; i < 100'000; ++i, now += ns_per_s / 1000) {
    const std::string address = std::to_string(i);
    const auto at = attempts.next_attempt(now, address);
    if (!at) continue;
    ++(*at == now ? at_once : later);
    attempts.failed(address);
  }
  EXPECT_EQ(at_once, Attempts::free_of_all);
  EXPECT_LE(later, static_cast<int>(Attempts::max_waiting) * (100 / 5 + 1));
  EXPECT_GE(later, 1);
}

TEST(Attempts, WhoKnowsThePhraseGetsInBesideSomebodyWhoGuessesAllTheTime) {
  SignIns sign_ins(2, idle_ns);
  for (int i = 0; i < 50; ++i) sign_ins.failed(0, "onlooker");
  EXPECT_EQ(sign_ins.next_attempt(0, 1, "onlooker"), 0) << "it is counted by operator, too";
  ASSERT_TRUE(sign_ins.next_attempt(0, 0, "onlooker"));
  const auto waits = sign_ins.next_attempt(1, 0, "alice");
  ASSERT_TRUE(waits);
  EXPECT_EQ(*waits, 1 + Attempts::pause_ns);
  sign_ins.right(0);
  EXPECT_EQ(sign_ins.next_attempt(2, 0, "onlooker"), 2) << "the right phrase resets the count";
}

TEST(OperatorCalls, ALeaseLetsTheGroundCommandAndAReleaseNamesNobody) {
  const crypto::IdentityName ground{"Org2MSP", "CN=ground"};
  const fabric::Call call =
      contract_call({.kind = OperatorCall::Kind::acquire, .drone = 0, .priority = 7}, "tello1", ground);
  EXPECT_EQ(call.function, contract::acquire);
  LeaseCall lease;
  ASSERT_TRUE(lease.ParseFromString(call.args.at(0)));
  EXPECT_EQ(lease.drones(0), "tello1");
  EXPECT_EQ(lease.priority(), 7U);
  EXPECT_EQ(to_name(lease.delegate()), ground);
  ASSERT_TRUE(lease.ParseFromString(
      contract_call({.kind = OperatorCall::Kind::release, .drone = 0}, "tello1", ground).args.at(0)));
  EXPECT_FALSE(lease.has_delegate());
  const fabric::Call over =
      contract_call({.kind = OperatorCall::Kind::hand_over, .drone = 0, .to = {"Org2MSP", "CN=bob"}}, "tello1", ground);
  AnswerCall answer;
  ASSERT_TRUE(answer.ParseFromString(over.args.at(0)));
  EXPECT_EQ(over.function, contract::hand_over);
  EXPECT_EQ(answer.to().subject(), "CN=bob");
}

}  // namespace
}  // namespace ledgerline::ground::service
