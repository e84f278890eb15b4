#pragma once
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/fabric/blocks/block_intake.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "peer/transaction.pb.h"
#include "tests/unit/common/fabric/validation/validated_channel.hpp"

namespace ledgerline::fabric {

inline Result<common::Block> nothing(std::uint64_t) { return Error{"nobody is asked"}; }

/// A chain of blocks as an honest peer serves them: transactions of every kind, good and spoilt.
class GrowingChannel : public ::testing::Test, protected ValidatedChannel {
 protected:
  GrowingChannel() : chain_{first_block_} {
    for (const Kind& kind : all_) {
      if (!kind.again) usable_.push_back(&kind);
    }
    // What the fixture has filled in is on the chain as well.
    state_ = KeyState();
    state_.configure(config_);
    state_.define("ledgerline");
    height_ = 0;
    Draft made = filling();
    for (const kvrwset::KVWrite& write : made.set.writes()) made.set.add_reads()->set_key(write.key());  // not there
    add({made.seal()});
  }

  /// The next block, as an honest peer serves it.
  void add(const std::vector<std::string>& envelopes) {
    common::Block block = node::make_block({chain_.size(), fabric::header_hash(chain_.back().header())}, envelopes);
    ASSERT_TRUE(node::sign_block(block, orderer_));
    const auto verdicts = validate(envelopes, rules_);
    std::string flags;
    for (const TransactionVerdict& one : verdicts) flags += static_cast<char>(one.code);
    block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, flags);
    if (part_) part_->apply(chain_.size(), validate_transactions(block, *part_, *members_, rules_));
    state_.apply(++height_, verdicts);
    chain_.push_back(std::move(block));
  }
  /// Another block of that number, which the orderers have signed as well.
  common::Block fork(std::size_t number, const std::string& envelope) {
    common::Block block = node::make_block({number, fabric::header_hash(chain_[number - 1].header())}, {envelope});
    EXPECT_TRUE(node::sign_block(block, orderer_));
    block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER, "");
    return block;
  }
  std::size_t below(std::size_t count) { return static_cast<std::size_t>(random_.next() % count); }
  /// Of every kind, good and spoilt, in blocks of up to four; some again.
  void grow(std::size_t transactions) {
    std::string last;
    for (std::size_t made = 0; made < transactions;) {
      std::vector<std::string> envelopes;
      const std::size_t count = 1 + below(4);
      for (std::size_t i = 0; i < count; ++i) {
        const bool again = !last.empty() && below(20) == 0;
        if (!again) {
          last_name_ = usable_[below(usable_.size())]->name;
          last = sealed(last_name_);
        }
        names_[{chain_.size(), i}] = last_name_ + (again ? ", again" : "");
        envelopes.push_back(last);
      }
      add(envelopes);
      made += count;
    }
  }

  BlockIntake make(BlockSource source = BlockSource::peer, std::function<TimeNs()> real_time = {}) const {
    return std::move(BlockIntake::make(
                         {.where = {},
                          .config_block = chain_[0].SerializeAsString(),
                          .make_registry = BlockValidator::registry_of(library),
                          .contract_rules = {.is_of_hot_path =
                                                 [](const std::string& key) { return key.starts_with("draft/free/"); }},
                          .real_time = std::move(real_time),
                          .source = source}))
        .value();
  }

  const ValidationRules rules_{"teleop", false};  ///< the embedded node's, of whose making the first block is
  std::optional<KeyState> part_;
  std::vector<common::Block> chain_;
  std::vector<const Kind*> usable_;
  std::string last_name_;
  std::map<std::pair<std::size_t, std::size_t>, std::string> names_;  ///< of the kinds, by block and place
};

}  // namespace ledgerline::fabric
