#include "common/fabric/blocks/block_intake.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/validation/block_validator.hpp"
#include "tests/fuzz/entry.hpp"
#include "tests/unit/common/fabric/validation/validated_channel.hpp"

/// What a trust anchor's file and a peer's blocks hold, before anybody trusts them.
namespace ledgerline::fuzz::validation_part {
namespace {

using namespace fabric;

/// Blocks 0 to 2 of a channel that is configured once and again.
class Chain : public SignedChain {
 public:
  Chain() {
    add("transaction", &orderer_);
    add(config_of(second_), &orderer_, 2);
  }
  const common::Block& block(std::size_t number) const { return chain_[number]; }
};
const Chain& chain() {
  static const Chain one;
  return one;
}

common::Block parsed(std::string_view bytes) {
  common::Block block;
  (void)block.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
  return block;
}

std::unique_ptr<Entry> anchor() {
  return std::make_unique<Function>(
      std::vector<std::string>{chain().block(0).SerializeAsString()},
      [](std::string_view bytes) { return outcome_of(BlockValidator::from(bytes, "teleop", library)); });
}

/// With its data's hash made right again: the configuration itself is reached.
std::unique_ptr<Entry> sealed_anchor() {
  return std::make_unique<Function>(
      std::vector<std::string>{chain().block(0).SerializeAsString()}, [](std::string_view bytes) {
        common::Block block = parsed(bytes);
        block.mutable_header()->set_data_hash(fabric::data_hash(block.data()));
        return outcome_of(BlockValidator::from(block.SerializeAsString(), "teleop", library));
      });
}

std::unique_ptr<Entry> block() {
  return std::make_unique<Function>(
      std::vector<std::string>{chain().block(1).SerializeAsString(), chain().block(2).SerializeAsString()},
      [](std::string_view bytes) {
        BlockValidator validator =
            std::move(BlockValidator::from(chain().block(0).SerializeAsString(), "teleop", library)).value();
        const Status verdict = validator.validate(parsed(bytes));
        return verdict ? accepted() : refused(verdict.error().message);
      });
}

/// What a peer answers when it is asked for configurations.
std::unique_ptr<Entry> caught_up() {
  return std::make_unique<Function>(
      std::vector<std::string>{chain().block(1).SerializeAsString(), chain().block(2).SerializeAsString()},
      [](std::string_view bytes) {
        BlockValidator validator =
            std::move(BlockValidator::from(chain().block(0).SerializeAsString(), "teleop", library)).value();
        const common::Block block = parsed(bytes);
        const Status verdict = validator.catch_up(chain().block(2), [&](std::uint64_t number) -> Result<common::Block> {
          return number == block.header().number() ? block : chain().block(std::min<std::uint64_t>(number, 2));
        });
        return verdict ? accepted() : refused(verdict.error().message);
      });
}

/// A channel with transactions of every kind.
class Transactions : public ValidatedChannel {
 public:
  std::vector<std::string> blocks() {
    std::vector<std::string> all;
    for (const fabric::Kind& kind : all_) {
      if (!kind.again) all.push_back(sealed_block(std::vector<std::string>{sealed(kind.name)}).SerializeAsString());
    }
    return all;
  }
  common::Block sealed_block(const std::vector<std::string>& envelopes) const {
    common::Block block = node::make_block({1, fabric::header_hash(first_block_.header())}, envelopes);
    (void)node::sign_block(block, orderer_);
    block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER,
                                           std::string(envelopes.size(), static_cast<char>(protos::VALID)));
    return block;
  }
  BlockIntake intake() const {
    return std::move(BlockIntake::make({.where = {},
                                        .config_block = first_block_.SerializeAsString(),
                                        .make_registry = BlockValidator::registry_of(library)}))
        .value();
  }
};

/// What a peer serves, once the orderers have signed it: any member can have anything ordered. Flags are as they come.
Outcome take_in(const Transactions& channel, std::string_view bytes) {
  const common::Block come = parsed(bytes);
  common::Block block = channel.sealed_block({come.data().data().begin(), come.data().data().end()});
  if (come.metadata().metadata_size() > common::TRANSACTIONS_FILTER)
    block.mutable_metadata()->set_metadata(common::TRANSACTIONS_FILTER,
                                           come.metadata().metadata(common::TRANSACTIONS_FILTER));
  BlockIntake intake = channel.intake();
  const auto taken = intake.add(block, [](std::uint64_t) -> Result<common::Block> { return Error{"none"}; });
  if (!taken) return refused(taken.error().message);
  for (const Transaction& transaction : taken->transactions) {
    if (transaction.code == protos::VALID) return accepted();
  }
  return refused(taken->transactions.empty() ? "no transaction" : "none of them is valid");
}

std::unique_ptr<Entry> taken_in() {
  static Transactions channel;
  std::vector<std::string> good;
  for (const std::string& block : channel.blocks()) {
    if (take_in(channel, block).verdict == Outcome::Verdict::accepted) good.push_back(block);
  }
  return std::make_unique<Function>(good, [](std::string_view bytes) { return take_in(channel, bytes); });
}

const Registration anchors({"validation.anchor", Kind::protobuf, anchor});
const Registration sealed_anchors({"validation.anchor_sealed", Kind::protobuf, sealed_anchor, 0.05});
const Registration blocks({"validation.block", Kind::protobuf, block});
const Registration taken({"validation.taken_in", Kind::protobuf, taken_in, 0.3});
const Registration fetched({"validation.fetched", Kind::protobuf, caught_up});

}  // namespace
}  // namespace ledgerline::fuzz::validation_part
