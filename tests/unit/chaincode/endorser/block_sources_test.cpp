#include "chaincode/endorser/core/peer_follower.hpp"

#include <gtest/gtest.h>

namespace ledgerline::endorser {
namespace {

using Source = BlockSources::Source;

/// Delivers a block, which is applied where it is accepted.
bool deliver(BlockSources& sources, Source from, std::uint64_t number, std::uint64_t& height) {
  if (!sources.accepts(from, number, height)) return false;
  height = number + 1;
  return true;
}

TEST(BlockSources, TheOwnStreamBringsWhatWasBeforeTheSharedOne) {
  BlockSources sources;
  std::uint64_t height = 0;
  sources.set_shared_connected(true);
  EXPECT_FALSE(sources.is_behind_reader(height)) << "its reader knows nothing yet";
  EXPECT_FALSE(deliver(sources, Source::shared, 5, height)) << "it is of later";
  EXPECT_FALSE(sources.try_join(height));
  EXPECT_TRUE(sources.is_behind_reader(height)) << "who has block 5 would get an answer of before it";
  for (std::uint64_t n = 0; n < 5; ++n) EXPECT_TRUE(deliver(sources, Source::own, n, height));
  EXPECT_FALSE(sources.try_join(height)) << "block 5 is still missing: the shared stream does not tell it again";
  EXPECT_TRUE(sources.depends_on(Source::own));
  EXPECT_TRUE(sources.is_behind_reader(height));
  EXPECT_TRUE(deliver(sources, Source::own, 5, height));
  EXPECT_FALSE(sources.is_behind_reader(height));
  EXPECT_TRUE(sources.try_join(height));
  EXPECT_FALSE(sources.try_join(height)) << "once";
  EXPECT_TRUE(sources.depends_on(Source::shared));
  EXPECT_FALSE(deliver(sources, Source::own, 6, height));
  EXPECT_TRUE(deliver(sources, Source::shared, 6, height));
}

TEST(BlockSources, TheFirstSourceOfABlockCounts) {
  BlockSources sources;
  std::uint64_t height = 7;
  sources.set_shared_connected(true);
  EXPECT_TRUE(deliver(sources, Source::shared, 7, height));
  EXPECT_FALSE(deliver(sources, Source::own, 7, height));
  EXPECT_TRUE(sources.try_join(height));
}

TEST(BlockSources, ASharedStreamThatIsBehindIsJoinedToo) {
  BlockSources sources;
  std::uint64_t height = 9;
  sources.set_shared_connected(true);
  EXPECT_FALSE(deliver(sources, Source::shared, 6, height));
  EXPECT_TRUE(sources.try_join(height));
  EXPECT_FALSE(deliver(sources, Source::shared, 8, height));
  EXPECT_TRUE(deliver(sources, Source::shared, 9, height));
}

TEST(BlockSources, ASharedStreamThatIsGoneIsNotJoined) {
  BlockSources sources;
  std::uint64_t height = 3;
  sources.set_shared_connected(true);
  EXPECT_FALSE(deliver(sources, Source::shared, 3 + 1, height));
  sources.set_shared_connected(false);
  for (std::uint64_t n = 3; n < 8; ++n) EXPECT_TRUE(deliver(sources, Source::own, n, height));
  EXPECT_FALSE(sources.try_join(height));
  sources.set_shared_connected(true);
  EXPECT_TRUE(sources.try_join(height)) << "it continues after the last one that it delivered";
}

TEST(BlockSources, AGapIsNotPassedOver) {
  BlockSources sources;
  std::uint64_t height = 2;
  EXPECT_TRUE(sources.accepts(Source::own, 4, height)) << "the core says that it is out of turn";
  sources.set_shared_connected(true);
  EXPECT_TRUE(deliver(sources, Source::shared, 2, height));
  EXPECT_TRUE(sources.try_join(height));
  EXPECT_TRUE(sources.accepts(Source::shared, 9, height)) << "likewise";
}

}  // namespace
}  // namespace ledgerline::endorser
