#pragma once
#include <optional>
#include <string>

#include "chaincode/contract/stub.hpp"
#include "chaincode/node/core/ledger/ledger.hpp"

namespace ledgerline::node {

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
