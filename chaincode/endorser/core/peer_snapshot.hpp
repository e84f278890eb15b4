#pragma once
#include <cstdint>
#include <string>
#include <string_view>

#include "chaincode/node/core/ledger/ledger.hpp"
#include "common/base/result.hpp"
#include "common/fabric/tx/transaction.hpp"

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

/// What the peer says. Nobody but its makers has signed any of it: see confirm().
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

}  // namespace ledgerline::endorser
