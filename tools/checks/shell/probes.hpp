#pragma once
#include <chrono>
#include <set>
#include <string>
#include <vector>

#include "tools/checks/core/host.hpp"
#include "tools/checks/core/identity.hpp"
#include "tools/checks/core/ledger.hpp"
#include "tools/checks/shell/configs.hpp"

/// What is seen of this host, of what the keys of a config name (files, servers, drones), and of what the peers say,
/// queried as the config's identity. Changes nothing, and writes nothing on the ledger.
namespace ledgerline {
class Config;
namespace fabric {
struct ClientConfig;
}
}  // namespace ledgerline
namespace ledgerline::checks {

IdentityInputs read_identity(const LedgerKeys& keys);

/// The trust anchor, or why there is none; and the organisations that it names.
struct AnchorInputs {
  std::string block{};  ///< bytes; empty: not read
  std::vector<AuthorityInputs> organisations{};
  bool embedded = false;
};
/// Adds to `findings` what is wrong with it.
AnchorInputs read_anchor(const LedgerKeys& keys, const std::string& program, Findings& findings);

TrustInputs read_trust(const LedgerKeys& keys, const std::string& program, const AnchorInputs& anchor);

/// Resolves, connects, and shakes hands by TLS with any server; then says hello in HTTP/2, since a server that wants a
/// certificate from its clients says so only then. Each step takes `timeout` at most. Without a tls_ca for
/// assess_presence() alone.
ServerInputs probe_server(const ServerKeys& keys, const std::string& what, std::chrono::milliseconds timeout);

/// Asks each drone of link's config for its battery, and hears whether its state texts come. Nothing is sent while link
/// runs.
Findings query_drones(const ProgramConfig& link);

/// Listens for some seconds, as agent does, for poses of those of link's drones that fly by motion capture.
Findings receive_poses(const ProgramConfig& link, const ProgramConfig& agent);

/// The client's config of the channel of `one`, as the program makes it.
Result<fabric::ClientConfig> client_of_channel(Config& config, const ProgramConfig& one);

/// That client, at another peer alone: with its TLS pair where it has one of its own.
fabric::ClientConfig client_at(const ServerKeys& peer, fabric::ClientConfig client);

/// Whose signatures a program's calls need.
struct NeededSignatures {
  fabric::Policy policy;                     ///< of calls that make records, by the contract's definition
  std::vector<std::string> organisations{};  ///< of the channel
  std::set<std::string> owners{};            ///< of the program's drones: commands need theirs
};

/// Lets the peers that agent or ground would ask, the config's or those that the gateway finds, sign a note that nobody
/// submits, and checks whose signatures come back.
Findings query_endorsers(const ProgramConfig& one, const fabric::ClientConfig& client, const NeededSignatures& needed);

/// Asks for configuration, contract, roles and the drones' records. `embedded`: its contract is its own.
Findings query_ledger(const ProgramConfig& one, const std::string& anchor, bool embedded,
                      const std::vector<std::string>& drones, std::chrono::milliseconds timeout);

}  // namespace ledgerline::checks
