#pragma once
#include <chrono>
#include <string>

#include "tools/checks/core/identity.hpp"
#include "tools/checks/core/server.hpp"
#include "tools/checks/shell/configs.hpp"

/// What is looked at by the keys of a config: files, servers, drones. Nothing is asked of the ledger.
namespace ledgerline::checks {

IdentityFacts read_identity(const LedgerKeys& keys);

/// The trust anchor, or why there is none; and the organisations that it names.
struct AnchorFacts {
  std::string block{};  ///< bytes; empty: not read
  std::vector<AuthorityFacts> organisations{};
  bool embedded = false;
};
/// Adds to `findings` what is wrong with it.
AnchorFacts read_anchor(const LedgerKeys& keys, const std::string& program, Findings& findings);

TrustFacts read_trust(const LedgerKeys& keys, const std::string& program, const AnchorFacts& anchor);

/// Resolves, connects, and shakes hands by TLS with any server; then says hello in HTTP/2, since a server that wants a
/// certificate from its clients says so only then. Each step takes `timeout` at most.
ServerFacts look_at_server(const ServerKeys& keys, const std::string& what, std::chrono::milliseconds timeout);

/// Asks each drone of link's config for its battery, and hears whether its state texts come. Nothing is sent while link
/// runs.
Findings ask_drones(const ProgramConfig& link);

/// Listens for some seconds, as agent does, for poses of those of link's drones that fly by motion capture.
Findings hear_poses(const ProgramConfig& link, const ProgramConfig& agent);

}  // namespace ledgerline::checks
