#include "common/fabric/blocks/block_intake.hpp"

#include <set>

#include "tests/unit/campaign.hpp"
#include "tests/unit/common/fabric/blocks/growing_channel.hpp"

/// What a program trusts of a peer's blocks that began to read them somewhere.
namespace ledgerline::fabric {
namespace {

class Intake : public GrowingChannel {
 protected:
  /// Kinds that the decoder cannot read as a call, or whose event it does not trust.
  static bool is_malformed(const std::string& kind) {
    for (const char* word : {"that is none", "that are none", "no action", "two actions", "event", "header", "type"}) {
      if (kind.find(word) != std::string::npos) return true;
    }
    return kind.starts_with("data") || kind.starts_with("an action");
  }

  /// From that block on; each flag as `bend` makes it.
  struct Taken {
    std::uint64_t honest = 0, lies = 0, reported = 0, flown = 0;
    BlockIntake::Counts counts;
  };
  Taken take(std::size_t from, const std::function<int(int flag)>& bend = {}) {
    BlockIntake intake = make();
    intake.define({});
    Taken taken;
    for (std::size_t number = from; number < chain_.size(); ++number) {
      common::Block block = chain_[number];
      std::string flags = block.metadata().metadata(common::TRANSACTIONS_FILTER);
      const std::string truth = flags;
      if (bend && number > from + 50) {
        for (char& flag : flags) flag = static_cast<char>(bend(static_cast<unsigned char>(flag)));
      }
      block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, flags);
      const auto read = intake.add(block, nothing);
      EXPECT_TRUE(read) << read.error().message;
      for (std::size_t i = 0; read && i < read->transactions.size(); ++i) {
        const Transaction& one = read->transactions[i];
        const bool lie = flags[i] != truth[i];
        ++(lie ? taken.lies : taken.honest);
        if (!one.problem.empty() && lie) ++taken.reported;
        // A stop is obeyed whatever its flag, so what was asked for stays readable.
        if (lie && one.code == code_unverified && !is_malformed(names_[{number, i}])) {
          EXPECT_FALSE(one.payload.empty()) << names_[{number, i}];
        }
        if (one.problem.empty() && lie && one.code == protos::VALID) ++taken.flown, ++undetected_[names_[{number, i}]];
        // The decoder leaves out what Fabric takes and nobody can read.
        if (lie || one.code == code_unverified) continue;
        EXPECT_EQ(one.problem, "") << "block " << number << ", " << i << ", flag " << int(truth[i]) << ", "
                                   << names_[{number, i}];
      }
    }
    taken.counts = intake.counts();
    return taken;
  }

  std::map<std::string, int> undetected_;  ///< wrong flags that were accepted, by kind
};

TEST_F(Intake, TrustsAnHonestPeerWhereverItBegins) {
  grow(static_cast<std::size_t>(seeds(600, 6'000)));
  for (const std::size_t from : {std::size_t(1), chain_.size() / 4, chain_.size() / 2, chain_.size() - 20}) {
    const Taken taken = take(from);
    EXPECT_GT(taken.honest, 20u);
    EXPECT_EQ(taken.counts.differ, 0u) << "from " << from;
  }
}

/// With room for all keys, and with so little that most are forgotten soon.
class IntakeOfPart : public Intake, public ::testing::WithParamInterface<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(WithRoomFor, IntakeOfPart, ::testing::Values(20'000, 12));

TEST_P(IntakeOfPart, APartKnowsNothingElseThanTheWhole) {
  grow(50);
  part_.emplace(KeyState::Part{.contract = "ledgerline", .max_keys = GetParam(), .max_ranges = GetParam() / 4});
  part_->configure(config_);
  part_->define("ledgerline");
  for (int block = 0; block < 300; ++block) {
    grow(1);
    for (const char* kind : {"free", "own", "range"}) {
      for (int i = 0; i < 20; ++i) {
        const KeyName name{"ledgerline", "", fmt::format("draft/{}/{}", kind, i)};
        const auto whole = state_.find(name), part = part_->find(name);
        const auto known = part_->known(name);
        if (known.version) {
          ASSERT_EQ(whole.has_value(), part.has_value()) << name.key << " block " << chain_.size() - 1;
        }
        if (known.version && whole) {
          ASSERT_EQ(whole->version, part->version) << name.key;
        }
        if (known.policy && part) {
          ASSERT_EQ(whole->policy, part->policy) << name.key;
        }
      }
    }
  }
}

TEST_F(Intake, AConfigurationOutOfItsTurnIsNotFollowed) {
  SignedChain later;  // of the same making: block 2 configures the channel again
  later.add("transaction", &later.orderer_);
  later.add(later.config_of(later.second_), &later.orderer_);
  BlockIntake intake = std::move(BlockIntake::make({.where = {},
                                                    .config_block = later.chain_[0].SerializeAsString(),
                                                    .make_registry = BlockValidator::registry_of(library)}))
                           .value();
  intake.start_at(1);
  EXPECT_FALSE(intake.add(later.chain_[2], nothing));
  common::Block forged = later.chain_[1];  // says that it knows a later configuration
  common::Metadata metadata;
  ASSERT_TRUE(metadata.ParseFromString(forged.metadata().metadata(common::SIGNATURES)));
  common::OrdererBlockMetadata value;
  value.mutable_last_config()->set_index(2);
  metadata.set_value(value.SerializeAsString());
  forged.mutable_metadata()->set_metadata(common::SIGNATURES, metadata.SerializeAsString());
  intake.begin();
  EXPECT_FALSE(intake.add(forged, [&](std::uint64_t number) { return Result<common::Block>(later.chain_[number]); }));
  intake.begin();
  const auto honest = intake.add(later.chain_[1], nothing);
  EXPECT_TRUE(honest) << honest.error().message;
  EXPECT_TRUE(intake.add(later.chain_[2], nothing));
}

TEST_F(Intake, ValidatesEverythingWhereItHasSeenTheKeysMade) {
  grow(600);
  const Taken taken = take(1);
  EXPECT_LT(taken.counts.by_flag * 4, taken.counts.validated);
  const auto flip = [](int flag) { return flag == protos::VALID ? protos::MVCC_READ_CONFLICT : protos::VALID; };
  const Taken lied = take(1, flip);
  EXPECT_GT(lied.lies, 300u);
  std::cout << taken.counts.validated << " validated, " << taken.counts.by_flag << " by flag; " << lied.lies
            << " lies, " << lied.reported << " reported, " << lied.flown << " accepted\n";
  EXPECT_GT(lied.reported * 10, lied.lies * 8);
  const std::set<std::string> of_others{"a contract that is not there", "a write to _lifecycle",
                                        "a write to a contract that is not there"};
  // Of others a few: what an invalid transaction would have written is not known for a while.
  int more = 0;
  for (const auto& [kind, times] : undetected_) more += of_others.contains(kind) ? 0 : times;
  EXPECT_LT(more * 20, static_cast<int>(lied.lies));
}

}  // namespace
}  // namespace ledgerline::fabric
