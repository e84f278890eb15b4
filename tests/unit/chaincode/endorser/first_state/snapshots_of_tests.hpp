#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "chaincode/endorser/core/endorser_core.hpp"
#include "chaincode/endorser/core/peer_snapshot.hpp"

/// Snapshots as a peer of Fabric writes them, for tests of those who read them.
namespace ledgerline::endorser {

/// As Fabric's files have them: a number, and bytes behind their length.
std::string go_number(std::uint64_t value);
std::string go_text(std::string_view bytes);
/// A record of public_state.data, behind its length.
std::string state_record(std::string_view key, const node::State::Value& value);

/// Keys of one namespace, in their order.
struct Namespace {
  std::string name;
  std::vector<std::string> records;  ///< state_record()
};
/// The files of these states, not sealed yet: in the order of namespaces.
void put_states(PeerSnapshotFiles& files, const std::vector<Namespace>& namespaces);
/// All namespaces that a peer would have which is at that end: of the contract, of the lifecycle, the configuration,
/// and those of contracts that nobody asks for.
std::vector<Namespace> namespaces_of(const Snapshot& known);
void put_ids(PeerSnapshotFiles& files, const node::State& contract);
/// What the snapshot says of itself, with the hashes that the files have now.
void seal(PeerSnapshotFiles& files, const node::ChainEnd& end, const std::string& channel = "teleop",
          const std::string& database = "SimpleKeyValueDB");

/// A whole one, of what an endorser that has read all blocks knows.
PeerSnapshotFiles snapshot_of(const Snapshot& known);

}  // namespace ledgerline::endorser
