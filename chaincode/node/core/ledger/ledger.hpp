#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "chaincode/contract/stub.hpp"
#include "chaincode/node/core/ledger/state.hpp"
#include "chaincode/node/core/tx/messages.hpp"
#include "common/base/result.hpp"
#include "common/common.pb.h"

namespace ledgerline::node {

/// The peer's ledger of the channel: the state that its blocks made, where the chain ends, and the blocks themselves,
/// which the caller keeps. The committer alone changes it. One thread at a time.
class Ledger {
 public:
  /// Gives back a block that was applied or replayed.
  using ReadBlock = std::function<Result<std::string>(std::uint64_t number)>;

  explicit Ledger(ReadBlock read_block) : read_block_(std::move(read_block)) {}

  const State& state() const { return state_; }
  State& state() { return state_; }
  const ChainEnd& end() const { return end_; }
  std::uint64_t height() const { return end_.height; }
  /// In place of all blocks up to that end.
  void restore(State state, ChainEnd end) {
    state_ = std::move(state);
    end_ = std::move(end);
  }
  /// The next block is in the state: it has this hash.
  void add_block(std::string hash);
  Result<common::Block> block_at(std::uint64_t number) const;

 private:
  ReadBlock read_block_;
  State state_;
  ChainEnd end_;
};

/// Finds in the blocks what was once written: the state keeps only where. `ledger` must outlive it. One thread at a
/// time.
class History {
 public:
  History(const Ledger& ledger, std::string contract) : ledger_(ledger), contract_(std::move(contract)) {}

  /// The value of `key` that this transaction wrote, with the transaction's id and its client's time.
  Result<chaincode::KeyVersion> version_of(const std::string& key, Version version);

 private:
  const Ledger& ledger_;
  const std::string contract_;
  std::optional<common::Block> block_;  ///< the one looked into last: many versions lie in one
};

}  // namespace ledgerline::node
