#pragma once
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "chaincode/node/core/ordering/budgets.hpp"
#include "chaincode/node/core/ordering/waiting.hpp"
#include "chaincode/node/core/tx/messages.hpp"
#include "chaincode/node/core/types.hpp"
#include "common/common.pb.h"

namespace ledgerline::node {

/// A block as it leaves the orderer: its transactions have no flags yet.
struct OrderedBlock {
  common::Block block;
  std::string warning;  ///< not empty: the block has no orderer's signature, and why
};

/// The channel's ordering service: takes members' envelopes, at most so many at a time, and cuts them into signed
/// blocks by count, bytes and time; who is first, and how much is whose, says Waiting. Urgency is earned: a transaction
/// has it whose result a peer of the channel has endorsed for this very proposal, and whose creator has places left in
/// UrgentBudget; what a sender merely says of itself counts for nothing. `config` must outlive it. One thread at a
/// time.
class Orderer {
 public:
  /// `is_committed`: whether a transaction of this id is in a block already.
  Orderer(const CoreConfig& config, MemberCheck members, crypto::SigningIdentity identity,
          std::function<bool(const std::string& tx_id)> is_committed)
      : config_(config),
        members_(std::move(members)),
        identity_(std::move(identity)),
        is_committed_(std::move(is_committed)),
        waiting_(config_),
        budget_(config_),
        invalid_(config_) {}

  /// The config block, as number 0.
  OrderedBlock genesis() const;
  /// NodeCore::order.
  Reply order(std::string_view envelope, Now now);
  /// Whether the disk is nearly full: then nothing is taken but what is urgent. Returns what was so before.
  bool set_nearly_full(bool nearly_full) { return std::exchange(nearly_full_, nearly_full); }
  /// When cut() has to be called: now or in the past when a block is full; nullopt when nothing waits.
  std::optional<TimeNs> next_cut() const;
  /// The block that follows `end`, if one is due.
  std::optional<OrderedBlock> cut(Now now, const ChainEnd& end);
  /// A transaction is in a block. A valid one gives its urgent place back, others are counted against their senders.
  void settle(const std::string& tx_id, bool valid) {
    budget_.settle(tx_id, valid);
    invalid_.settle(tx_id, valid, ordered_ns_);
  }

 private:
  Urgency claimed_urgency(const common::Payload& payload) const;
  bool is_endorsed(std::string_view envelope, Now now) const;
  OrderedBlock sign(common::Block block) const;

  const CoreConfig& config_;
  const MemberCheck members_;
  const crypto::SigningIdentity identity_;
  const std::function<bool(const std::string& tx_id)> is_committed_;
  Waiting waiting_;
  UrgentBudget budget_;
  InvalidBudget invalid_;
  TimeNs ordered_ns_ = 0;  ///< when order() was called last
  bool nearly_full_ = false;
};

}  // namespace ledgerline::node
