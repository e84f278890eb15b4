#include "chaincode/endorser/core/peer_follower.hpp"

#include <gtest/gtest.h>

namespace ledgerline::endorser {
namespace {

fabric::Checkpoint of(std::uint64_t number, const std::string& hash = "h") { return {"c", number, hash, "records"}; }

TEST(PendingCheckpoint, WhatThePeerHasReportedIsWrittenAtOnce) {
  PendingCheckpoint pending;
  EXPECT_FALSE(pending.on_peer_block(4, "h"));
  const auto due = pending.offer(of(4));
  ASSERT_TRUE(due);
  EXPECT_EQ(due->number, 4U);
  EXPECT_FALSE(pending.on_peer_block(5, "h")) << "once";
}

TEST(PendingCheckpoint, WhatAnOrdererAloneHasReportedWaitsForThePeer) {
  PendingCheckpoint pending;
  EXPECT_FALSE(pending.offer(of(5))) << "the peer has reported nothing yet";
  EXPECT_FALSE(pending.on_peer_block(4, "h"));
  const auto due = pending.on_peer_block(5, "h");
  ASSERT_TRUE(due);
  EXPECT_EQ(due->number, 5U);
  EXPECT_FALSE(pending.on_peer_block(6, "h")) << "once";
}

TEST(PendingCheckpoint, ANewerOneTakesThePlaceOfOneThatWaits) {
  PendingCheckpoint pending;
  EXPECT_FALSE(pending.on_peer_block(1, "h"));
  EXPECT_FALSE(pending.offer(of(5)));
  EXPECT_FALSE(pending.offer(of(9)));
  EXPECT_FALSE(pending.on_peer_block(5, "h"));
  EXPECT_TRUE(pending.on_peer_block(9, "h"));
}

TEST(PendingCheckpoint, OneOfAnotherBlockThanThePeersIsNeverWritten) {
  PendingCheckpoint pending;
  EXPECT_FALSE(pending.offer(of(5, "forged")));
  EXPECT_FALSE(pending.on_peer_block(5, "h"));
  EXPECT_FALSE(pending.on_peer_block(6, "h"));
}

TEST(PendingCheckpoint, ABlockThatIsReportedAgainTakesNothingBack) {
  PendingCheckpoint pending;
  EXPECT_FALSE(pending.on_peer_block(7, "h"));
  EXPECT_FALSE(pending.on_peer_block(3, "h"));
  EXPECT_TRUE(pending.offer(of(6)));
}

}  // namespace
}  // namespace ledgerline::endorser
