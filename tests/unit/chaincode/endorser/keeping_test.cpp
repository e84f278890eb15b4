#include "chaincode/endorser/core/keeping.hpp"

#include <gtest/gtest.h>

namespace ledgerline::endorser {
namespace {

fabric::Checkpoint of(std::uint64_t number, const std::string& hash = "h") { return {"c", number, hash, "records"}; }

TEST(Keeping, WhatThePeerHasToldIsWrittenAtOnce) {
  Keeping keeping;
  EXPECT_FALSE(keeping.told(4, "h"));
  const auto due = keeping.offer(of(4));
  ASSERT_TRUE(due);
  EXPECT_EQ(due->number, 4U);
  EXPECT_FALSE(keeping.told(5, "h")) << "once";
}

TEST(Keeping, WhatAnOrdererAloneHasToldWaitsForThePeer) {
  Keeping keeping;
  EXPECT_FALSE(keeping.offer(of(5))) << "the peer has told nothing yet";
  EXPECT_FALSE(keeping.told(4, "h"));
  const auto due = keeping.told(5, "h");
  ASSERT_TRUE(due);
  EXPECT_EQ(due->number, 5U);
  EXPECT_FALSE(keeping.told(6, "h")) << "once";
}

TEST(Keeping, ANewerOneTakesThePlaceOfOneThatWaits) {
  Keeping keeping;
  EXPECT_FALSE(keeping.told(1, "h"));
  EXPECT_FALSE(keeping.offer(of(5)));
  EXPECT_FALSE(keeping.offer(of(9)));
  EXPECT_FALSE(keeping.told(5, "h"));
  EXPECT_TRUE(keeping.told(9, "h"));
}

TEST(Keeping, OneOfAnotherBlockThanThePeersIsNeverWritten) {
  Keeping keeping;
  EXPECT_FALSE(keeping.offer(of(5, "forged")));
  EXPECT_FALSE(keeping.told(5, "h"));
  EXPECT_FALSE(keeping.told(6, "h"));
}

TEST(Keeping, ABlockThatIsToldAgainTakesNothingBack) {
  Keeping keeping;
  EXPECT_FALSE(keeping.told(7, "h"));
  EXPECT_FALSE(keeping.told(3, "h"));
  EXPECT_TRUE(keeping.offer(of(6)));
}

}  // namespace
}  // namespace ledgerline::endorser
