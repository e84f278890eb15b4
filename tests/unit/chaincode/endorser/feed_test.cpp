#include "chaincode/endorser/core/feed.hpp"

#include <gtest/gtest.h>

namespace ledgerline::endorser {
namespace {

using Source = Feed::Source;

/// Tells a block, and takes it where it is wanted.
bool tell(Feed& feed, Source from, std::uint64_t number, std::uint64_t& height) {
  if (!feed.wants(from, number, height)) return false;
  height = number + 1;
  return true;
}

TEST(Feed, TheOwnStreamBringsWhatWasBeforeTheSharedOne) {
  Feed feed;
  std::uint64_t height = 0;
  feed.shared_connected(true);
  EXPECT_FALSE(tell(feed, Source::shared, 5, height)) << "it is of later";
  EXPECT_FALSE(feed.joins(height));
  for (std::uint64_t n = 0; n < 5; ++n) EXPECT_TRUE(tell(feed, Source::own, n, height));
  EXPECT_FALSE(feed.joins(height)) << "block 5 is still missing: the shared stream does not tell it again";
  EXPECT_TRUE(feed.follows(Source::own));
  EXPECT_TRUE(tell(feed, Source::own, 5, height));
  EXPECT_TRUE(feed.joins(height));
  EXPECT_FALSE(feed.joins(height)) << "once";
  EXPECT_TRUE(feed.follows(Source::shared));
  EXPECT_FALSE(tell(feed, Source::own, 6, height));
  EXPECT_TRUE(tell(feed, Source::shared, 6, height));
}

TEST(Feed, TheFirstSourceOfABlockCounts) {
  Feed feed;
  std::uint64_t height = 7;
  feed.shared_connected(true);
  EXPECT_TRUE(tell(feed, Source::shared, 7, height));
  EXPECT_FALSE(tell(feed, Source::own, 7, height));
  EXPECT_TRUE(feed.joins(height));
}

TEST(Feed, ASharedStreamThatIsBehindIsJoinedToo) {
  Feed feed;
  std::uint64_t height = 9;
  feed.shared_connected(true);
  EXPECT_FALSE(tell(feed, Source::shared, 6, height));
  EXPECT_TRUE(feed.joins(height));
  EXPECT_FALSE(tell(feed, Source::shared, 8, height));
  EXPECT_TRUE(tell(feed, Source::shared, 9, height));
}

TEST(Feed, ASharedStreamThatIsGoneIsNotJoined) {
  Feed feed;
  std::uint64_t height = 3;
  feed.shared_connected(true);
  EXPECT_FALSE(tell(feed, Source::shared, 3 + 1, height));
  feed.shared_connected(false);
  for (std::uint64_t n = 3; n < 8; ++n) EXPECT_TRUE(tell(feed, Source::own, n, height));
  EXPECT_FALSE(feed.joins(height));
  feed.shared_connected(true);
  EXPECT_TRUE(feed.joins(height)) << "it continues after the last one that it delivered";
}

TEST(Feed, AGapIsNotPassedOver) {
  Feed feed;
  std::uint64_t height = 2;
  EXPECT_TRUE(feed.wants(Source::own, 4, height)) << "the core says that it is out of turn";
  feed.shared_connected(true);
  EXPECT_TRUE(tell(feed, Source::shared, 2, height));
  EXPECT_TRUE(feed.joins(height));
  EXPECT_TRUE(feed.wants(Source::shared, 9, height)) << "likewise";
}

}  // namespace
}  // namespace ledgerline::endorser
