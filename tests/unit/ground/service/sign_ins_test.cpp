#include "ground/service/operators/sign_ins.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/belief/identity.hpp"
#include "common/msg/contract.hpp"
#include "ground/service/operators/calls.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::ground::service {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
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

TEST(SignIns, GuessingIsSlowAndOfOneOperatorAlone) {
  SignIns sign_ins(2, idle_ns);
  for (int i = 0; i < SignIns::free_failures; ++i) {
    EXPECT_EQ(sign_ins.refused(i, 0), "");
    sign_ins.failed(i, 0);
  }
  EXPECT_THAT(sign_ins.refused(ns_per_s, 0), HasSubstr("wait"));
  EXPECT_EQ(sign_ins.refused(ns_per_s, 1), "");
  EXPECT_EQ(sign_ins.refused(31 * ns_per_s, 0), "");
  sign_ins.failed(31 * ns_per_s, 0);
  EXPECT_THAT(sign_ins.refused(32 * ns_per_s, 0), HasSubstr("30 s")) << "one more, half a minute more";
  sign_ins.begin(62 * ns_per_s, 0, "token");
  EXPECT_EQ(sign_ins.refused(62 * ns_per_s, 0), "") << "who knows it begins anew";
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
  EXPECT_EQ(belief::to_name(lease.delegate()), ground);
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
