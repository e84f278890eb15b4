#include <gmock/gmock.h>

#include "chaincode/node/core/tx/messages.hpp"
#include "common/fabric/tx/transaction.hpp"

namespace ledgerline::node {
namespace {

TEST(BlockTest, HeaderHashesAreThoseThatClientsCompute) {
  for (const std::uint64_t number : {0ULL, 1ULL, 127ULL, 128ULL, 255ULL, 256ULL, 1ULL << 63}) {
    common::BlockHeader header;
    header.set_number(number);
    header.set_previous_hash(std::string(32, 'p'));
    header.set_data_hash(std::string(32, 'd'));
    EXPECT_EQ(header_hash(header), fabric::block_header_hash(number, header.previous_hash(), header.data_hash()));
  }
}

TEST(BlockTest, ABlockFollowsTheEndOfTheChainAndHasRoomForSignaturesAndFlags) {
  const common::Block block = make_block({7, "hash of block 6"}, {"one", "two"});
  EXPECT_EQ(block.header().number(), 7U);
  EXPECT_EQ(block.header().previous_hash(), "hash of block 6");
  EXPECT_EQ(block.header().data_hash(), data_hash(block.data()));
  EXPECT_EQ(block.data().data_size(), 2);
  EXPECT_EQ(block.metadata().metadata_size(), common::COMMIT_HASH + 1);
}

}  // namespace
}  // namespace ledgerline::node
