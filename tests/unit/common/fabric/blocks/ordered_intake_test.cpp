#include <algorithm>
#include <iostream>
#include <set>

#include "tests/unit/campaign.hpp"
#include "tests/unit/common/fabric/blocks/growing_channel.hpp"

/// What a program trusts of blocks that an orderer tells before the own peer does.
namespace ledgerline::fabric {
namespace {

class OrderedIntake : public GrowingChannel {
 protected:
  common::Block ordered(std::size_t number) const {
    common::Block block = chain_[number];
    block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, "");
    return block;
  }
  /// A state, endorsed by enough, made ten seconds behind those of the block before.
  std::string state(std::size_t key = 1) {
    Draft made = draft();
    write(made, "draft/free/" + std::to_string(key));
    made.channel_header.mutable_timestamp()->set_seconds(2'000 + 10 * static_cast<std::int64_t>(chain_.size()));
    return made.seal();
  }
  /// Of every kind, and as many blocks of states alone.
  void grow_with_states(std::size_t transactions) {
    for (std::size_t made = 0; made < transactions; made += 4) {
      grow(1 + below(3));
      std::vector<std::string> states;
      for (std::size_t i = 0; i <= below(3); ++i) states.push_back(state(below(20)));
      add(states);
    }
  }
  common::Block fork(std::size_t number) { return GrowingChannel::fork(number, state()); }
  /// Begun at a peer, whose first block, `from`, it has taken.
  BlockIntake begun(
      std::size_t from, BlockSource source = BlockSource::ordered,
      std::function<TimeNs()> real_time = [] { return 1'000 * ns_per_s; }) {
    BlockIntake intake = make(source, std::move(real_time));
    intake.start_at(from);
    intake.begin();
    intake.define({});
    const auto first = intake.add(chain_[from], nothing);
    EXPECT_TRUE(first) << first.error().message;
    EXPECT_EQ(intake.begin_ordered(), from + 1);
    return intake;
  }
  /// What comes of it.
  static Result<std::vector<Block>> tell(BlockIntake& intake, common::Block block) {
    if (const Status added = intake.add_ordered(std::move(block)); !added) return added.error();
    return pop_ordered(intake);
  }
  static Result<std::vector<Block>> pop_ordered(BlockIntake& intake) {
    std::vector<Block> out;
    while (true) {
      auto ordered = intake.pop_ordered();
      if (!ordered) return ordered.error();
      if (!*ordered) return out;
      out.push_back(std::move((*ordered)->block));
    }
  }
  static int flag_of(const common::Block& block, std::size_t i) {
    return static_cast<unsigned char>(block.metadata().metadata(common::TRANSACTIONS_FILTER)[i]);
  }
  /// That each transaction is as an honest peer flags it.
  void expect_true(const Block& block) {
    for (std::size_t i = 0; i < block.transactions.size(); ++i) {
      if (block.transactions[i].code == code_unverified) continue;  // nobody can read it
      const int flag = flag_of(chain_.at(block.number), i);
      if (!block.confirmed && flag == protos::DUPLICATE_TXID) continue;
      EXPECT_EQ(block.transactions[i].code == protos::VALID, flag == protos::VALID)
          << "block " << block.number << ", " << i << ", " << names_[{block.number, i}];
    }
  }

  /// Two streams of the whole chain, of which now one and now the other is ahead; `bend` what an orderer tells.
  struct Walk {
    std::uint64_t taken = 0, refused = 0;
    BlockIntake::Counts counts;
  };
  void walk(std::size_t from, Walk& out, const std::function<bool(common::Block&)>& bend = {}) {
    // No clock tells what was before: each that was counts as new, and is found out by the peer's word.
    BlockIntake intake = begun(from, BlockSource::ordered, [] { return -10 * ns_per_s; });
    std::size_t of_peer = from + 1, of_orderer = from + 1;
    out = {};
    std::uint64_t next = from + 1;
    const auto take = [&](const Block& block) {
      EXPECT_EQ(block.number, next++) << "in order, no gap, no duplicate";
      EXPECT_EQ(block.data_hash, chain_[block.number].header().data_hash());
      expect_true(block);
      ++out.taken;
    };
    const auto take_all = [&](const Result<std::vector<Block>>& blocks) {
      if (!blocks) return false;
      for (const Block& block : *blocks) take(block);
      return true;
    };
    while (next < chain_.size() || intake.confirms_next()) {
      ASSERT_FALSE(intake.contradiction());
      if (of_orderer < chain_.size() && of_orderer < of_peer + 6 && below(3) != 0) {
        common::Block reported = ordered(of_orderer++);
        const bool bent = bend && below(4) == 0 && bend(reported);
        const bool good = take_all(tell(intake, std::move(reported)));
        out.refused += good ? 0 : 1;
        if (!good || bent) of_orderer = intake.begin_ordered().value();  // of another one
      } else if (of_peer < of_orderer || below(4) == 0) {
        if (below(50) == 0) {  // its connection breaks
          intake.begin();
          of_peer = intake.next_of_peer().value();
        }
        if (intake.confirms_next()) {
          const auto confirmed = intake.confirm(chain_.at(of_peer));
          ASSERT_TRUE(confirmed) << confirmed.error().message;
        } else {
          const auto block = intake.add(chain_.at(of_peer), nothing);
          ASSERT_TRUE(block) << block.error().message;
          take(*block);
        }
        ++of_peer;
        if (!take_all(pop_ordered(intake))) of_orderer = intake.begin_ordered().value();
      }
    }
    EXPECT_EQ(out.taken, chain_.size() - from - 1);
    out.counts = intake.counts();
  }
};

TEST_F(OrderedIntake, TakesWhatIsOrderedAsAnHonestPeerFlagsIt) {
  grow_with_states(static_cast<std::size_t>(seeds(600, 6'000)));
  for (const std::size_t from : {std::size_t(1), chain_.size() / 4, chain_.size() / 2}) {
    for (int i = 0; i < 4; ++i) {
      Walk walked;
      walk(from, walked);
      EXPECT_GT(walked.counts.ordered_first * 10, walked.taken);
      EXPECT_EQ(walked.counts.confirmed, walked.counts.ordered_first);
      if (i == 0)
        std::cout << "from " << from << ": " << walked.taken << " blocks, " << walked.counts.ordered_first
                  << " as they were ordered, " << walked.counts.uncertain << " waited\n";
    }
  }
}

TEST_F(OrderedIntake, AnOrdererThatLiesIsRefusedAndThePeerGoesOn) {
  grow_with_states(static_cast<std::size_t>(seeds(400, 4'000)));
  const std::vector<std::function<bool(common::Block&)>> lies{
      [](common::Block& block) {  // forged
        block.mutable_metadata()->set_metadata(common::SIGNATURES, "");
        return true;
      },
      [](common::Block& block) {  // other data than were signed
        block.mutable_data()->set_data(0, block.data().data(0) + 'x');
        return true;
      },
      [this](common::Block& block) {  // bytes
        std::string bytes = block.SerializeAsString();
        bytes[below(bytes.size())] ^= static_cast<char>(1 + below(255));
        // What is not signed may be anything.
        return block.ParseFromString(bytes);
      },
      [this](common::Block& block) {  // out of order
        const std::size_t other = 1 + below(chain_.size() - 1);
        if (other == block.header().number()) return false;
        block = ordered(other);
        return true;
      },
      [](common::Block& block) {  // flags of its own
        block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER,
                                               std::string(block.data().data_size(), '\0'));
        return true;
      }};
  for (const auto& lie : lies) {
    Walk walked;
    walk(1, walked, lie);
    EXPECT_GT(walked.counts.ordered_first, 0u);
    std::cout << walked.taken << " blocks, " << walked.counts.ordered_first << " as they were ordered, "
              << walked.refused << " times an orderer was refused\n";
  }
}

TEST_F(OrderedIntake, AForkOfTheOrderersIsFoundWithThePeersBlock) {
  for (int i = 0; i < 3; ++i) add({state()});
  const std::size_t last = chain_.size() - 1;
  const std::string found = fmt::format("block {} of the peer is not the one that was ordered", last);
  BlockIntake first = begun(last - 1);
  ASSERT_EQ(tell(first, fork(last))->size(), 1u);
  EXPECT_FALSE(first.confirm(chain_[last]));
  EXPECT_EQ(first.contradiction(), found);
  EXPECT_FALSE(first.pop_ordered()) << "for good";
  EXPECT_FALSE(first.add(chain_[last], nothing));

  BlockIntake behind = begun(last - 1);  // the peer is first
  EXPECT_TRUE(behind.add(chain_[last], nothing));
  EXPECT_FALSE(tell(behind, fork(last)));
  EXPECT_EQ(behind.contradiction(), found);
}

TEST_F(OrderedIntake, AFlagThatIsNotOurVerdictIsAContradiction) {
  grow_with_states(300);
  BlockIntake intake = begun(1);
  for (std::size_t number = 2; number < chain_.size(); ++number) {
    const auto blocks = tell(intake, ordered(number));
    ASSERT_TRUE(blocks) << blocks.error().message;
    if (blocks->empty()) {
      ASSERT_TRUE(intake.add(chain_[number], nothing));
      continue;
    }
    common::Block lie = chain_[number];
    std::string flags = lie.metadata().metadata(common::TRANSACTIONS_FILTER);
    flags[0] = static_cast<char>(protos::MVCC_READ_CONFLICT);
    lie.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, flags);
    EXPECT_FALSE(intake.confirm(lie));
    EXPECT_NE(intake.contradiction()->find("does not flag transaction 0 valid"), std::string::npos);
    return;
  }
  FAIL() << "no block was taken as it was ordered";
}

/// A write of a free key, by its maker's clock made then.
class OrderedByClock : public OrderedIntake {
 protected:
  static constexpr std::int64_t start_s = 1'000;
  std::string written(std::int64_t made_s, const std::string& nonce, const std::string& key = "draft/free/1") {
    Draft made = draft();
    write(made, key);
    made.nonce = nonce;
    made.channel_header.mutable_timestamp()->set_seconds(made_s);
    return made.seal();
  }
  /// Follows from block 4 on, at start_s: what was before is not known.
  BlockIntake begin_at_block_4() {
    add({written(start_s - 10, "old")});
    add({written(start_s - 9, "first")});
    add({written(start_s - 8, "second")});
    return begun(4, BlockSource::ordered, [] { return start_s * ns_per_s; });
  }
  /// Taken as it was ordered?
  bool comes(BlockIntake& intake, const std::string& envelope) {
    add({envelope});
    const auto blocks = tell(intake, ordered(chain_.size() - 1));
    EXPECT_TRUE(blocks) << blocks.error().message;
    return blocks && !blocks->empty();
  }
};

TEST_F(OrderedByClock, WhatMayHaveBeenReportedLongAgoWaitsForThePeer) {
  BlockIntake intake = begin_at_block_4();
  EXPECT_FALSE(comes(intake, written(start_s - 10, "old"))) << "the very same as block 2";
  const auto block = intake.add(chain_.back(), nothing);
  ASSERT_TRUE(block);
  EXPECT_EQ(block->transactions[0].code, protos::DUPLICATE_TXID);
}

TEST_F(OrderedByClock, WhatIsNewByItsMakersClockComesAndAnotherKeyDoesNot) {
  BlockIntake intake = begin_at_block_4();
  EXPECT_TRUE(comes(intake, written(start_s + 60, "new")));
  EXPECT_EQ(intake.confirm(chain_.back()).value(), 0u);
  EXPECT_FALSE(comes(intake, written(start_s + 1, "too near to the start")));
  ASSERT_TRUE(intake.add(chain_.back(), nothing));
  EXPECT_FALSE(comes(intake, written(start_s + 60, "not delivered twice without harm", "draft/range/1")));
}

TEST_F(OrderedByClock, WhoReadsWhatMayHaveBeenReportedTwiceWaits) {
  BlockIntake intake = begin_at_block_4();
  EXPECT_TRUE(comes(intake, written(start_s + 60, "old"))) << "invalid, as the peer will say";
  Draft reader = draft();
  write(reader, "draft/free/2");
  reader.set.add_reads()->set_key("draft/free/1");
  reader.set.mutable_reads(0)->mutable_version()->set_block_num(4);
  reader.channel_header.mutable_timestamp()->set_seconds(start_s + 60);
  EXPECT_FALSE(comes(intake, reader.seal()));
  EXPECT_EQ(intake.confirm(chain_[chain_.size() - 2]).value(), 1u);
  const auto block = intake.add(chain_.back(), nothing);
  ASSERT_TRUE(block) << block.error().message;
  EXPECT_EQ(block->transactions[0].code, protos::VALID);
}

TEST_F(OrderedByClock, AnOrderersFlagsAreNobodysWord) {
  BlockIntake intake = begin_at_block_4();
  add({written(start_s - 10, "old")});
  common::Block flagged = ordered(chain_.size() - 1);
  flagged.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, std::string(1, '\0'));
  EXPECT_TRUE(tell(intake, flagged)->empty());
}

TEST_F(OrderedByClock, WhoUsesAnIdTwiceUnderAnotherTimeStopsNobody) {
  BlockIntake intake = begin_at_block_4();
  EXPECT_TRUE(comes(intake, written(start_s + 60, "old"))) << "the id of block 2";
  EXPECT_EQ(chain_.back().metadata().metadata(common::TRANSACTIONS_FILTER)[0], protos::DUPLICATE_TXID);
  const auto reported_again = intake.confirm(chain_.back());
  ASSERT_TRUE(reported_again) << reported_again.error().message;
  EXPECT_EQ(*reported_again, 1u);
  EXPECT_FALSE(intake.contradiction());
  EXPECT_TRUE(comes(intake, written(start_s + 61, "and goes on"))) << "what it has written is known again by this";
  EXPECT_EQ(intake.confirm(chain_.back()).value(), 0u);
}

TEST_F(OrderedIntake, IsNeverFurtherAheadOfThePeerThanItsBound) {
  for (std::size_t i = 0; i < 3 * BlockIntake::max_unconfirmed; ++i) {
    add({state()});
  }
  BlockIntake intake = begun(1);
  std::size_t taken = 0;
  for (std::size_t number = 2; number < chain_.size(); ++number) {
    const auto blocks = tell(intake, ordered(number));
    ASSERT_TRUE(blocks) << blocks.error().message;
    taken += blocks->size();
  }
  EXPECT_EQ(taken, BlockIntake::max_unconfirmed);
  for (std::size_t number = 2; number < 12; ++number) ASSERT_TRUE(intake.confirm(chain_[number]));
  EXPECT_EQ(pop_ordered(intake)->size(), 10u) << "what has waited";
}

TEST(ReportedHeaders, KeepABoundedNumber) {
  ReportedHeaders reported;
  common::Block block;
  for (std::uint64_t number = 0; number < 2 * ReportedHeaders::max_kept; ++number) {
    block.mutable_header()->set_number(number);
    reported.ordered(block, "a");
    reported.of_peer(number, "b");
  }
  EXPECT_FALSE(reported.pop_ordered(0));
  EXPECT_FALSE(reported.pop_of_peer(ReportedHeaders::max_kept - 1));
  EXPECT_TRUE(reported.pop_of_peer(ReportedHeaders::max_kept));
  EXPECT_EQ(reported.pop_ordered(2 * ReportedHeaders::max_kept - 1)->hash, "a");
  EXPECT_FALSE(reported.pop_ordered(2 * ReportedHeaders::max_kept - 1)) << "each once";
}

}  // namespace
}  // namespace ledgerline::fabric
