#include "chaincode/endorser/core/keeping.hpp"

#include <gtest/gtest.h>

namespace ledgerline::endorser {
namespace {

fabric::Checkpoint of(std::uint64_t number, const std::string& hash = "h") { return {"c", number, hash, "records"}; }

TEST(Keeping, WhatThePeerHasReportedIsWrittenAtOnce) {
  Keeping keeping;
  EXPECT_FALSE(keeping.reported(4, "h"));
  const auto due = keeping.offer(of(4));
  ASSERT_TRUE(due);
  EXPECT_EQ(due->number, 4U);
  EXPECT_FALSE(keeping.reported(5, "h")) << "once";
}

TEST(Keeping, WhatAnOrdererAloneHasReportedWaitsForThePeer) {
  Keeping keeping;
  EXPECT_FALSE(keeping.offer(of(5))) << "the peer has reported nothing yet";
  EXPECT_FALSE(keeping.reported(4, "h"));
  const auto due = keeping.reported(5, "h");
  ASSERT_TRUE(due);
  EXPECT_EQ(due->number, 5U);
  EXPECT_FALSE(keeping.reported(6, "h")) << "once";
}

TEST(Keeping, ANewerOneTakesThePlaceOfOneThatWaits) {
  Keeping keeping;
  EXPECT_FALSE(keeping.reported(1, "h"));
  EXPECT_FALSE(keeping.offer(of(5)));
  EXPECT_FALSE(keeping.offer(of(9)));
  EXPECT_FALSE(keeping.reported(5, "h"));
  EXPECT_TRUE(keeping.reported(9, "h"));
}

TEST(Keeping, OneOfAnotherBlockThanThePeersIsNeverWritten) {
  Keeping keeping;
  EXPECT_FALSE(keeping.offer(of(5, "forged")));
  EXPECT_FALSE(keeping.reported(5, "h"));
  EXPECT_FALSE(keeping.reported(6, "h"));
}

TEST(Keeping, ABlockThatIsReportedAgainTakesNothingBack) {
  Keeping keeping;
  EXPECT_FALSE(keeping.reported(7, "h"));
  EXPECT_FALSE(keeping.reported(3, "h"));
  EXPECT_TRUE(keeping.offer(of(6)));
}

}  // namespace
}  // namespace ledgerline::endorser
