#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "common/fabric/checkpoint/continuation.hpp"
#include "common/fabric/judge/block_judge.hpp"
#include "common/fabric/judge/key_state.hpp"
#include "common/fabric/judge/transaction_judge.hpp"
#include "common/fabric/tx/transaction.hpp"

namespace ledgerline::fabric {

/// What is believed of the blocks that a peer serves, without its I/O: the core of every stream of blocks. Each must be
/// the next of the chain and signed by the channel's orderers; each of its transactions is judged by the rule of
/// judge_transactions, as far as what came through here tells, and its flag believed beyond that.
/// Pure but for the registries' caches; one thread. The same blocks give the same results.
class BlockIntake {
 public:
  struct Setup {
    ChannelAndContract where;
    /// As ClientConfig::config_block. Empty: neither blocks nor transactions are judged, the peer is believed.
    std::string config_block;
    BlockJudge::MakeRegistry make_registry;
    /// As ClientConfig::likely_policy.
    std::function<std::optional<std::string>(const std::string& key)> likely_policy{};
    /// Whether somebody else has the same block, by the hash of its header; in words what differs. Empty: nobody is asked.
    std::function<std::string(std::uint64_t number, const std::string& hash)> compare{};
  };
  /// An error: the config block is none.
  static Result<BlockIntake> make(Setup setup);

  /// A connection begins: configurations between the one that is known and its first block are fetched.
  void begin() { caught_up_ = false; }
  /// The first block; without it the first that comes.
  void start_at(std::uint64_t number) { next_ = number; }
  /// Goes on behind a checkpoint: an error where the peer's chain, whose newest block that is, cannot be the believed one.
  using Fetch = BlockJudge::Fetch;
  Result<Continuation> continue_chain(const Believed& believed, const common::Block& newest, const Fetch& fetch);

  /// The next block, with what is to be believed of its transactions: one that is flagged valid and is not is left out
  /// (code_unbelievable), one that is flagged invalid and is valid says so in its `problem`. An error: it is not the next
  /// block, which may still come.
  Result<Block> take(const common::Block& message, const Fetch& fetch);

  /// Whose endorsement the contract's keys need (protos.ApplicationPolicy), where no block has told it: it lies behind the
  /// first one, and somebody has said what it is.
  void define(const std::string& policy);
  /// Whether that is worth asking.
  bool misses_definition() const { return state_ && !defined_; }

  std::optional<std::uint64_t> next() const { return next_; }

  struct Counts {
    std::uint64_t judged = 0;   ///< transactions whose flag rests on our own judgement as well
    std::uint64_t by_flag = 0;  ///< on the peer's word
    std::uint64_t differ = 0;   ///< of those that are judged
  };
  const Counts& counts() const { return counts_; }

 private:
  explicit BlockIntake(Setup setup) : setup_(std::move(setup)) {}
  Status judge_block(const common::Block& message, const Fetch& fetch);
  void judge_transactions(const common::Block& message, Block& block);
  void configure();
  void forget();

  Setup setup_;
  std::optional<BlockJudge> judge_;
  bool caught_up_ = false;
  std::optional<std::uint64_t> next_;
  ChainCheck chain_;

  // Of the transactions; none where they are not judged.
  std::optional<KeyState> state_;
  std::unique_ptr<crypto::MspRegistry> members_;
  JudgeRules rules_;
  std::uint64_t configured_ = 0;  ///< the config block by which that is so
  bool defined_ = false;
  Counts counts_;
};

}  // namespace ledgerline::fabric
