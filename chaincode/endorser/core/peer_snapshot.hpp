#pragma once
#include <cstdint>
#include <string>
#include <string_view>

#include "chaincode/node/core/ledger/ledger.hpp"
#include "common/base/result.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/fabric/validation/block_validator.hpp"

/// A snapshot of a channel as a peer of Fabric 2.5 makes it (`peer snapshot submitrequest`).
namespace ledgerline::endorser {

/// The files that are read, under the names that Fabric gives them. What else lies in the folder (history of
/// collections, hashes of private data) the contract does not need.
namespace peer_snapshot_file {
inline constexpr std::string_view description = "_snapshot_signable_metadata.json";
inline constexpr std::string_view description_hash = "_snapshot_additional_metadata.json";
inline constexpr std::string_view states = "public_state.data";
inline constexpr std::string_view states_counts = "public_state.metadata";
inline constexpr std::string_view ids = "txids.data";
inline constexpr std::string_view ids_count = "txids.metadata";
}  // namespace peer_snapshot_file

/// What is in them.
struct PeerSnapshotFiles {
  std::string description, description_hash;
  std::string states, states_counts;
  std::string ids, ids_count;
};

/// What the peer says. Nobody but its makers has signed any of it: see verify_snapshot().
struct PeerSnapshot {
  node::ChainEnd end;              ///< of the newest block in it
  std::string config;              ///< common.ConfigEnvelope, the channel's newest
  std::uint64_t config_block = 0;  ///< where it was committed
  /// The contract's keys with values, versions and policies, and the ids of all transactions, as of the newest block
  /// and with its number, since the snapshot does not say theirs; of the lifecycle the keys alone.
  node::State contract, lifecycle;
};

/// An error names the file: it is not the one that the description names by its SHA-256, not whole, of another format,
/// or the snapshot is of another channel. `hash`: SHA-256 of the description, in hex, from somebody who is trusted;
/// empty: nobody has said it. Takes no more memory than the files.
Result<PeerSnapshot> read_peer_snapshot(const PeerSnapshotFiles& files, const fabric::ChannelAndContract& where,
                                        std::string_view hash);

/// Whether an endorser may begin with a peer's snapshot in place of all blocks up to it: its newest block must be in
/// the chain that `fetch` brings, and signed by the channel's orderers, by the configurations from the trust anchor on,
/// which `validator` knows. Gives the newest of these that the snapshot can have, common.Block: nothing of a
/// configuration is the snapshot's word. What the contract's keys hold is. An error says what is not so, or which block
/// did not come. Pure.
Result<std::string> verify_snapshot(const PeerSnapshot& reported, fabric::BlockValidator& validator,
                                    const fabric::BlockValidator::Fetch& fetch);

}  // namespace ledgerline::endorser
