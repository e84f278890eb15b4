#include "chaincode/endorser/core/readiness.hpp"

#include <gtest/gtest.h>

namespace ledgerline::endorser {
namespace {

const Readiness::DefinedAt first{fabric::Version{1, 0}}, second{fabric::Version{9, 0}};

Readiness agreed_at(const Readiness::DefinedAt& definition) {
  Readiness one;
  one.on_connection(true);
  one.take_height(one.connection(), 3);
  EXPECT_EQ(one.take_check(Comparison::same, definition, definition), "");
  return one;
}

TEST(Readiness, WaitsForTheBlocksThatThePeerHadWhenTheStreamBegan) {
  Readiness one;
  EXPECT_FALSE(one.ready(10)) << "no stream";
  one.on_connection(true);
  EXPECT_FALSE(one.ready(10)) << "the peer has not said its height";
  EXPECT_TRUE(one.wants_height());
  EXPECT_TRUE(one.take_height(one.connection(), 10));
  EXPECT_FALSE(one.ready(9));
  EXPECT_TRUE(one.ready(10));
}

TEST(Readiness, AHeightOfBeforeTheStreamBrokeIsNotTaken) {
  Readiness one;
  one.on_connection(true);
  const std::uint64_t before = one.connection();
  one.on_connection(false);
  one.on_connection(true);
  EXPECT_FALSE(one.take_height(before, 10));
  EXPECT_FALSE(one.ready(10));
}

TEST(Readiness, AStreamThatIsGoneTakesItAway) {
  Readiness one = agreed_at(first);
  EXPECT_TRUE(one.ready(3));
  one.on_connection(false);
  EXPECT_FALSE(one.ready(3));
  one.on_connection(true);
  EXPECT_FALSE(one.ready(3)) << "blocks may have come meanwhile";
}

TEST(Readiness, ANewDefinitionIsAgreedAgain) {
  Readiness one;
  EXPECT_FALSE(one.agreed(std::nullopt)) << "nor does it sign at its start, on the embedded node either";
  one = agreed_at(first);
  EXPECT_TRUE(one.agreed(first));
  EXPECT_FALSE(one.agreed(second));
  EXPECT_EQ(one.take_check(Comparison::same, first, second), "");
  EXPECT_FALSE(one.agreed(second)) << "that check was of the old one";
}

TEST(Readiness, ADifferenceEndsIt) {
  Readiness one = agreed_at(first);
  EXPECT_NE(one.take_check(Comparison::differ, first, first), "");
}

TEST(Readiness, AStateThatStaysAnotherEndsIt) {
  Readiness one = agreed_at(first);
  for (int i = 0; i < 2; ++i) EXPECT_EQ(one.take_check(Comparison::other_state, first, first), "");
  EXPECT_NE(one.take_check(Comparison::other_state, first, first), "");
}

TEST(Readiness, APeerThatHasNotApprovedIsWaitedFor) {
  Readiness one = agreed_at(first);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(one.take_check(Comparison::other_state, second, second), "");
  EXPECT_FALSE(one.agreed(second));
}

TEST(Readiness, AfterAFailureItNeverAnswers) {
  Readiness one = agreed_at(first);
  one.fail();
  one.on_connection(true);
  one.take_height(one.connection(), 0);
  EXPECT_FALSE(one.ready(100));
}

}  // namespace
}  // namespace ledgerline::endorser
