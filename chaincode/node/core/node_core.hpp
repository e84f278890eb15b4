#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "chaincode/node/core/committer.hpp"
#include "chaincode/node/core/endorser.hpp"
#include "chaincode/node/core/ordering/orderer.hpp"
#include "chaincode/node/core/types.hpp"
#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {

/// One channel of a Fabric network: an Endorser, an Orderer and a Committer around one Ledger. It does no I/O:
/// proposals, envelopes and time in; answers and blocks out. The same inputs give the same bytes (with deterministic
/// signers). One thread at a time.
///
///     endorse(proposal) -> envelope; the client signs it
///     order(envelope)   -> waits
///     cut(now)          -> block  -> [caller writes and syncs it] -> apply(block) -> statuses, answers to waiters
///
/// From cut to apply at most one block is in progress: endorsements see the state before it, envelopes keep waiting.
class NodeCore {
 public:
  using ReadBlock = Ledger::ReadBlock;
  using Counts = Committer::Counts;

  /// `peers`: one for each organisation, all of them endorse. `orderer`: signs blocks.
  NodeCore(CoreConfig config, const std::shared_ptr<crypto::MspRegistry>& registry,
           const std::vector<crypto::SigningIdentity>& peers, crypto::SigningIdentity orderer, ReadBlock read_block);
  NodeCore(const NodeCore&) = delete;
  NodeCore& operator=(const NodeCore&) = delete;

  /// The config block, as number 0: for an empty ledger. To be written, then given to apply() as any other.
  CutBlock genesis() { return committer_.validate(orderer_.genesis()); }
  /// Takes a block from disk: state, history, transaction ids. In order, before anything else.
  Status replay(std::string_view block) { return committer_.replay(block); }
  std::uint64_t height() const { return ledger_.height(); }

  /// gateway.Endorse. In: protos.SignedProposal. Out: common.Envelope without signature, endorsed by all peers.
  Reply endorse(std::string_view signed_proposal, Now now) { return endorser_.endorse(signed_proposal, now); }
  /// gateway.Evaluate. In: protos.SignedProposal. Out: protos.Response.
  Reply evaluate(std::string_view signed_proposal, Now now) { return endorser_.evaluate(signed_proposal, now); }
  /// protos.Endorser.ProcessProposal. Out: protos.ProposalResponse of that one of the peers (refusals too, as Fabric
  /// does; a code only when the proposal cannot be answered). Here and in evaluate the peer's own contracts answer as
  /// well (query_system_contract).
  Reply process_proposal(std::string_view signed_proposal, Now now, std::size_t peer) {
    return endorser_.process_proposal(signed_proposal, now, peer);
  }
  /// Of the first peer.
  Reply process_proposal(std::string_view signed_proposal, Now now) {
    return process_proposal(signed_proposal, now, 0);
  }
  /// gateway.Submit and orderer.Broadcast. In: common.Envelope. Out: nothing; ok = accepted for ordering. `detail` of a
  /// refusal is in the words of Fabric's gateway; invalid_argument stands for the orderer's BAD_REQUEST,
  /// permission_denied for FORBIDDEN, unavailable for SERVICE_UNAVAILABLE, not_found for BAD_REQUEST as well, but the
  /// gateway distinguishes it: an unknown channel.
  Reply order(std::string_view envelope, Now now) { return orderer_.order(envelope, now); }
  /// Whether the disk is nearly full: then order() takes nothing but endorsed commands, stops and who may do what.
  /// Returns what was so before.
  bool set_nearly_full(bool nearly_full) { return orderer_.set_nearly_full(nearly_full); }
  /// Checks a signed request of a member: `signature` of `message` by `serialized` (a msp.SerializedIdentity).
  Result<crypto::IdentityName> check_signer(std::string_view serialized, std::string_view message,
                                            std::string_view signature, Now now) const;

  /// When cut() has to be called: now or in the past when a block is full; nullopt when nothing waits or a block is in
  /// progress.
  std::optional<TimeNs> next_cut() const;
  /// Makes the next block if one is due: full, or the oldest envelope's time is up.
  std::optional<CutBlock> cut(Now now);
  /// Commits the block that cut() or genesis() gave. Only after it is on disk.
  std::vector<WaiterAnswer> apply(const CutBlock& block);

  /// As Committer's functions of these names.
  std::optional<TxStatus> watch(const std::string& tx_id, std::uint64_t waiter) {
    return committer_.watch(tx_id, waiter);
  }
  void unwatch(const std::string& tx_id, std::uint64_t waiter) { committer_.unwatch(tx_id, waiter); }
  std::optional<TxStatus> find(const std::string& tx_id) const { return committer_.find(tx_id); }
  Counts counts() const { return committer_.counts(); }

 private:
  const CoreConfig config_;
  const MemberCheck members_;
  Ledger ledger_;
  Endorser endorser_;
  Orderer orderer_;
  Committer committer_;
};

}  // namespace ledgerline::node
