#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "chaincode/node/core/ledger/ledger.hpp"
#include "chaincode/node/core/ordering/orderer.hpp"
#include "chaincode/node/core/types.hpp"
#include "common/fabric/validation/transaction_validator.hpp"

namespace ledgerline::node {

struct TxStatus {
  std::string tx_id;
  std::uint64_t block = 0;
  int code = 0;  ///< protos.TxValidationCode; 0 = VALID, 9 = DUPLICATE_TXID, 10 = ENDORSEMENT_POLICY_FAILURE, 11 = MVCC
};

/// A block that was cut and validated, on its way to the disk.
struct CutBlock {
  std::uint64_t number = 0;
  std::string bytes;  ///< common.Block with flags in metadata[2]
  std::vector<TxStatus> transactions;
  std::set<std::string> writers{};  ///< MSP ids of who has signed its valid transactions
  std::string warning{};            ///< not empty: the block has no orderer's signature, and why
};

/// What a waiter is to get (see watch).
struct WaiterAnswer {
  std::uint64_t waiter;
  TxStatus status;
};

/// The peer's committing half: says of each transaction of an ordered block whether it is valid, puts the block into
/// the ledger once it is on disk, and notifies those who wait. Blocks from disk are replayed without validating them
/// again. From validate() to apply() exactly one block is in progress. `config` and `ledger` must outlive it. One
/// thread at a time.
class Committer {
 public:
  Committer(const CoreConfig& config, std::shared_ptr<crypto::MspRegistry> members, Ledger& ledger);

  CutBlock validate(OrderedBlock ordered);
  bool has_block_in_progress() const { return block_in_progress_.has_value(); }
  /// Commits the block that validate() gave. Only after it is on disk. Answers in the order in which waiters came.
  std::vector<WaiterAnswer> apply(const CutBlock& block);
  /// Takes a block from disk: state, history, transaction ids. In order, before anything else.
  Status replay(std::string_view block);

  /// A transaction's status if it is committed; otherwise `waiter` (a name that the caller chose) gets it from apply().
  std::optional<TxStatus> watch(const std::string& tx_id, std::uint64_t waiter);
  void unwatch(const std::string& tx_id, std::uint64_t waiter);
  std::optional<TxStatus> find(const std::string& tx_id) const;

  /// Since the ledger began; the config block is not among the transactions.
  struct Counts {
    std::uint64_t blocks = 0, transactions = 0, invalid = 0;
  };
  const Counts& counts() const { return counts_; }

 private:
  struct Write {
    Version version;
    kvrwset::KVRWSet set;
    std::string writer;  ///< MSP id
  };
  struct BlockInProgress {
    std::string hash;
    std::vector<Write> writes;
  };
  Status check_follows(const common::Block& block, const std::string& name) const;
  void replay_transaction(std::string_view envelope, Version at, int code);

  const CoreConfig& config_;
  const fabric::ValidationRules rules_;
  const std::shared_ptr<crypto::MspRegistry> members_;
  const StateView view_;
  Ledger& ledger_;
  std::optional<BlockInProgress> block_in_progress_;
  std::map<std::string, std::vector<std::uint64_t>> waiters_;
  Counts counts_;
};

}  // namespace ledgerline::node
