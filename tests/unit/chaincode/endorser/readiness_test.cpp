#include "chaincode/endorser/core/peer_follower.hpp"

#include <gtest/gtest.h>

namespace ledgerline::endorser {
namespace {

const Readiness::DefinedAt first{fabric::Version{1, 0}}, second{fabric::Version{9, 0}};

Readiness agreed_at(const Readiness::DefinedAt& definition) {
  Readiness one;
  one.on_connection(true);
  one.set_peer_height(one.connection(), 3);
  EXPECT_TRUE(one.record_comparison(Comparison::same, definition, definition).ok());
  return one;
}

TEST(Readiness, WaitsForTheBlocksThatThePeerHadWhenTheStreamBegan) {
  Readiness one;
  EXPECT_FALSE(one.check(10).ok()) << "no stream";
  one.on_connection(true);
  EXPECT_FALSE(one.check(10).ok()) << "the peer has not said its height";
  EXPECT_TRUE(one.needs_height());
  EXPECT_TRUE(one.set_peer_height(one.connection(), 10));
  EXPECT_FALSE(one.check(9).ok());
  EXPECT_TRUE(one.check(10).ok());
}

TEST(Readiness, AHeightOfBeforeTheStreamBrokeIsNotTaken) {
  Readiness one;
  one.on_connection(true);
  const std::uint64_t before = one.connection();
  one.on_connection(false);
  one.on_connection(true);
  EXPECT_FALSE(one.set_peer_height(before, 10));
  EXPECT_FALSE(one.check(10).ok());
}

TEST(Readiness, AStreamThatIsGoneTakesItAway) {
  Readiness one = agreed_at(first);
  EXPECT_TRUE(one.check(3).ok());
  one.on_connection(false);
  EXPECT_FALSE(one.check(3).ok());
  one.on_connection(true);
  EXPECT_FALSE(one.check(3).ok()) << "blocks may have come meanwhile";
}

TEST(Readiness, ANewDefinitionIsAgreedAgain) {
  Readiness one;
  EXPECT_FALSE(one.has_agreed(std::nullopt)) << "nor does it sign at its start, on the embedded node either";
  one = agreed_at(first);
  EXPECT_TRUE(one.has_agreed(first));
  EXPECT_FALSE(one.has_agreed(second));
  EXPECT_TRUE(one.record_comparison(Comparison::same, first, second).ok());
  EXPECT_FALSE(one.has_agreed(second)) << "that check was of the old one";
}

TEST(Readiness, ADifferenceEndsIt) {
  Readiness one = agreed_at(first);
  EXPECT_FALSE(one.record_comparison(Comparison::differ, first, first).ok());
}

TEST(Readiness, AStateThatStaysAnotherEndsIt) {
  Readiness one = agreed_at(first);
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(one.record_comparison(Comparison::other_state, first, first).ok());
  EXPECT_FALSE(one.record_comparison(Comparison::other_state, first, first).ok());
}

TEST(Readiness, APeerThatHasNotApprovedIsWaitedFor) {
  Readiness one = agreed_at(first);
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(one.record_comparison(Comparison::other_state, second, second).ok());
  EXPECT_FALSE(one.has_agreed(second));
}

TEST(Readiness, AfterAFailureItNeverAnswers) {
  Readiness one = agreed_at(first);
  one.fail();
  one.on_connection(true);
  one.set_peer_height(one.connection(), 0);
  EXPECT_FALSE(one.check(100).ok());
}

}  // namespace
}  // namespace ledgerline::endorser
