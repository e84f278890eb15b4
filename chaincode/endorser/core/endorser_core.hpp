#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "chaincode/node/core/endorser.hpp"
#include "chaincode/node/core/ledger/ledger.hpp"
#include "chaincode/node/core/types.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/fabric/validation/block_validator.hpp"

namespace ledgerline::endorser {

/// What an endorser knows behind its newest block, so that it need not read the chain again.
struct Snapshot {
  node::ChainEnd end;
  std::string config_block;  ///< common.Block, the newest with a configuration
  node::State contract, lifecycle;
};

/// Numbers little-endian, texts behind their length, keys in their order.
std::string to_bytes(const node::ChainEnd& end, std::string_view config_block, const node::State& contract,
                     const node::State& lifecycle);
/// An error: the bytes are not whole, or more than that. Takes no more memory than the bytes say they hold.
Result<Snapshot> read_snapshot(std::string_view bytes);

/// What it says of any question that is not of its contract: it is no peer, and keeps no blocks.
inline constexpr const char* for_its_contract_alone = "the endorser answers for its contract alone";

/// An organisation's own endorser, without its I/O: the channel's blocks, from the first one on, and members' proposals
/// in; answers out, byte for byte those of a peer of the organisation that has taken the same blocks (but for the
/// signature). It runs the contract against the state that the blocks made, and keeps that state in memory: the keys of
/// the contract with their policies, the ids of all transactions, and the contract's definition. One thread at a time.
class EndorserCore {
 public:
  struct Setup {
    fabric::ChannelAndContract where;
    crypto::SigningIdentity identity;  ///< OU=peer, of its own: SECURITY.md says what its key can do
    fabric::BlockValidator::MakeRegistry make_registry;
  };
  explicit EndorserCore(Setup setup);
  EndorserCore(const EndorserCore&) = delete;
  EndorserCore& operator=(const EndorserCore&) = delete;

  /// The next block, as a stream that validates blocks handed it over (fabric::Client::blocks): `block` says which of
  /// the transactions in `raw` (common.Block) count. An error: it is not the next one, or a configuration in it is not
  /// read.
  Status apply(const fabric::Block& block, std::string_view raw);
  std::uint64_t height() const { return ledger_.height(); }
  /// The newest block's header's, as ChainCheck has it; empty: there is none.
  const std::string& hash() const { return ledger_.end().hash; }
  /// All that it knows, for restore() at another start.
  std::string snapshot() const;
  /// Before the first block: what a core of the same channel and contract knew. An error, and nothing has changed: the
  /// bytes are not whole. A writer of these bytes decides what is endorsed, so they are protected like the key.
  Status restore(std::string_view bytes);
  Status restore(Snapshot known);
  /// Where the definition that counts was committed; none on the embedded node, which has no definitions.
  std::optional<node::Version> defined_at() const;

  /// Signs with this renewed identity from now on. An error, and the old one goes on: by the newest configuration no
  /// endorsement of it would count.
  Status renew(crypto::SigningIdentity next);

  /// protos.Endorser.ProcessProposal, as NodeCore's. What only a peer can answer (history, other contracts and
  /// channels) is `unavailable`, as everything is once the own certificate has expired or is revoked: clients then ask
  /// the peer. `own`: this process has signed the proposal.
  node::Reply process_proposal(std::string_view signed_proposal, node::Now now, bool own = false);

 private:
  std::optional<node::Definition> read_definition() const;
  Status configure(const common::Block& message);
  /// Whether what this identity endorses counts for the channel's organisations.
  Status check_role(const crypto::SigningIdentity& identity) const;
  bool is_valid(const fabric::Transaction& transaction, std::uint64_t block) const;
  void write(const std::string& envelope, node::Version at);

  Setup setup_;
  const node::CoreConfig config_;
  std::int64_t expires_s_;
  bool asks_for_blocks_ = false;
  std::string config_block_;                    ///< the newest with a configuration
  std::vector<crypto::MspRoot> organisations_;  ///< as it has them; empty: there is none yet
  bool embedded_node_ = false;
  node::Ledger ledger_;
  node::State lifecycle_;                       ///< the keys of the namespace _lifecycle
  std::optional<node::Definition> definition_;  ///< what they say
  Status role_ = done;                          ///< check_role() of the own identity by the newest configuration
  node::Endorser endorser_;
};

}  // namespace ledgerline::endorser
