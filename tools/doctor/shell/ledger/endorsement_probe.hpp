#pragma once
#include <set>
#include <string>
#include <vector>

#include "common/fabric/client/client.hpp"
#include "tools/doctor/core/endorsement.hpp"
#include "tools/doctor/shell/configs.hpp"

namespace ledgerline::doctor {

/// Whose signatures a program's calls need.
struct NeededSignatures {
  fabric::Policy policy;                     ///< of calls that make records, by the contract's definition
  std::vector<std::string> organisations{};  ///< of the channel
  std::set<std::string> owners{};            ///< of the program's drones: commands need theirs
};

/// Lets the peers that agent or ground would ask, the config's or those that the gateway finds, sign a note that nobody
/// submits, and checks whose signatures come back. Nothing is written on the ledger.
Findings ask_endorsers(const ProgramConfig& one, const fabric::ClientConfig& client, const NeededSignatures& needed);

}  // namespace ledgerline::doctor
