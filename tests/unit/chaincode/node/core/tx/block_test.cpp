#include <gmock/gmock.h>

#include "chaincode/node/core/tx/messages.hpp"
#include "common/fabric/tx/envelope.hpp"

namespace ledgerline::node {
namespace {

TEST(BlockTest, ABlockFollowsTheEndOfTheChainAndHasRoomForSignaturesAndFlags) {
  const common::Block block = make_block({7, "hash of block 6"}, {"one", "two"});
  EXPECT_EQ(block.header().number(), 7U);
  EXPECT_EQ(block.header().previous_hash(), "hash of block 6");
  EXPECT_EQ(block.header().data_hash(), fabric::data_hash(block.data()));
  EXPECT_EQ(block.data().data_size(), 2);
  EXPECT_EQ(block.metadata().metadata_size(), common::COMMIT_HASH + 1);
}

}  // namespace
}  // namespace ledgerline::node
