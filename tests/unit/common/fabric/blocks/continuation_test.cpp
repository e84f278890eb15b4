#include "common/fabric/blocks/checkpoint.hpp"

#include <gmock/gmock.h>

#include "tests/unit/common/fabric/tx/chain_of_tests.hpp"

namespace ledgerline::fabric {
namespace {

using ::testing::HasSubstr;

class ContinuationTest : public ::testing::Test {
 protected:
  ContinuationTest() {
    for (int i = 0; i < 10; ++i)
      chain_.push_back(make_block(chain_.empty() ? nullptr : &chain_.back(), {"block " + std::to_string(i)}, "\x02"));
  }
  LastVerified verified(std::size_t number, std::uint64_t max_absence) const {
    const auto& header = chain_[number].header();
    return {{"teleop", number, block_header_hash(number, header.previous_hash(), header.data_hash()), {}}, max_absence};
  }
  Result<Continuation> ask(const LastVerified& verified) {
    return continue_behind(verified, chain_.back(), [this](std::uint64_t number) -> Result<common::Block> {
      fetched_.push_back(number);
      if (number >= chain_.size()) return Error{"no such block"};
      return chain_[number];
    });
  }

  std::vector<common::Block> chain_;
  std::vector<std::uint64_t> fetched_;
};

TEST_F(ContinuationTest, AfterAShortAbsenceEachBlockComes) {
  const auto on = ask(verified(5, 4));
  ASSERT_TRUE(on);
  EXPECT_FALSE(on->gap);
  EXPECT_EQ(on->chain.height(), 6U);
  EXPECT_EQ(on->newest, 9U);
  ChainCheck chain = on->chain;
  EXPECT_TRUE(chain.add(*decode_block(chain_[6].SerializeAsString())));
}

TEST_F(ContinuationTest, AfterALongOneTheCheckpointsBlockAloneIsFetched) {
  const auto on = ask(verified(5, 3));
  ASSERT_TRUE(on);
  EXPECT_TRUE(on->gap);
  EXPECT_EQ(on->verified, 5U);
  EXPECT_EQ(on->newest, 9U);
  EXPECT_EQ(on->chain.height(), 10U);
  EXPECT_EQ(on->chain.hash(), verified(9, 0).last.hash);
  EXPECT_EQ(fetched_, std::vector<std::uint64_t>{5});
}

TEST_F(ContinuationTest, WithNothingNewThereIsNoGap) {
  const auto on = ask(verified(9, 0));
  ASSERT_TRUE(on);
  EXPECT_FALSE(on->gap);
  EXPECT_EQ(on->chain.height(), 10U);
  EXPECT_TRUE(fetched_.empty());
}

TEST_F(ContinuationTest, AChainThatEndsBeforeWhatWasTrustedIsRefused) {
  LastVerified later = verified(9, 1'000);
  later.last.number = 12;
  const auto on = ask(later);
  ASSERT_FALSE(on);
  EXPECT_THAT(on.error().message, HasSubstr("serves a chain that ends at block 9; we have verified block 12"));
}

TEST_F(ContinuationTest, AForkIsRefusedHoweverHighItIs) {
  for (const std::size_t number : {9U, 8U, 1U}) {
    for (const std::uint64_t max_absence : {0U, 1'000U}) {
      LastVerified other = verified(number, max_absence);
      other.last.hash[0] = static_cast<char>(other.last.hash[0] ^ 1);
      const auto on = ask(other);
      ASSERT_FALSE(on) << number;
      EXPECT_THAT(on.error().message,
                  HasSubstr("serves another block " + std::to_string(number) + " than the one that we have verified"));
    }
  }
}

TEST_F(ContinuationTest, WhoDoesNotShowTheBlockIsNotFollowed) {
  const auto on = continue_behind(verified(5, 1'000), chain_.back(),
                                  [](std::uint64_t) -> Result<common::Block> { return Error{"not given"}; });
  ASSERT_FALSE(on);
  EXPECT_EQ(on.error().message, "not given");
}

}  // namespace
}  // namespace ledgerline::fabric
