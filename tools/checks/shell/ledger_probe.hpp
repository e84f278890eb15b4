#pragma once
#include <chrono>
#include <set>
#include <string>
#include <vector>

#include "common/config/config.hpp"
#include "common/fabric/client/client.hpp"
#include "tools/checks/core/ledger.hpp"
#include "tools/checks/shell/configs.hpp"

/// What the peers of a program's config say, asked as its identity. Nothing is written on the ledger.
namespace ledgerline::checks {

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
Findings ask_endorsers(const ProgramConfig& one, const fabric::ClientConfig& client, const NeededSignatures& needed);

/// Asks for configuration, contract, roles and the drones' records. `embedded`: its contract is its own.
Findings ask_ledger(const ProgramConfig& one, const std::string& anchor, bool embedded,
                    const std::vector<std::string>& drones, std::chrono::milliseconds timeout);

}  // namespace ledgerline::checks
