#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "chaincode/node/core/ledger/ledger.hpp"
#include "chaincode/node/core/member_check.hpp"
#include "chaincode/node/core/orderer.hpp"
#include "chaincode/node/core/tx/proposal.hpp"
#include "chaincode/node/core/types.hpp"
#include "common/fabric/tx/policy.hpp"

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
  std::string warning;  ///< not empty: the block has no orderer's signature, and why
};

struct Applied {
  std::uint64_t block = 0;
  std::vector<TxStatus> transactions;
  /// Answers to waiters (see watch), in the order in which they came.
  struct Answer {
    std::uint64_t waiter;
    TxStatus status;
  };
  std::vector<Answer> answers;
};

/// The peer's committing half: says of each transaction of an ordered block whether it is valid, puts the block into
/// the ledger once it is on disk, and tells those who wait. Blocks from disk are replayed without judging again. From
/// validate() to apply() one block is under way, and none besides it. `config` and `ledger` must outlive it. One thread
/// at a time.
class Committer {
 public:
  /// `endorsers`: the peers (msp.SerializedIdentity) whose endorsements count.
  Committer(const CoreConfig& config, MemberCheck members, std::vector<std::string> endorsers, Ledger& ledger)
      : config_(config), members_(std::move(members)), endorsers_(std::move(endorsers)), ledger_(ledger) {}

  CutBlock validate(OrderedBlock ordered, Now now);
  bool under_way() const { return under_way_.has_value(); }
  /// Commits the block that validate() gave. Only after it is on disk.
  Applied apply(const CutBlock& block);
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
  };
  struct UnderWay {
    std::string hash;
    std::vector<Write> writes;
  };
  std::vector<TxStatus> validate_all(const common::Block& block, Now now, std::vector<Write>& writes);
  /// A protos.TxValidationCode of everything but what was read; fills `set` when it is VALID.
  int validate_form(const TransactionParts& transaction, Now now, kvrwset::KVRWSet& set);
  /// Which of the members' peers have endorsed, each once.
  std::vector<fabric::Endorser> endorsers_of(const TransactionParts& transaction, Now now) const;
  /// Fabric's rule: a key with a policy of its own needs what that says, the others what the contract's says, which is a
  /// majority of the organisations; so does a transaction that writes nothing.
  bool satisfies_policies(const kvrwset::KVRWSet& set, const std::vector<fabric::Endorser>& endorsers) const;
  Status check_follows(const common::Block& block, const std::string& name) const;
  void replay_transaction(std::string_view envelope, Version at, int code);

  const CoreConfig& config_;
  const MemberCheck members_;
  const std::vector<std::string> endorsers_;
  Ledger& ledger_;
  std::optional<UnderWay> under_way_;
  std::set<std::string> new_policies_;  ///< keys whose policy the block under validation has changed so far
  std::map<std::string, std::vector<std::uint64_t>> waiters_;
  Counts counts_;
};

}  // namespace ledgerline::node
