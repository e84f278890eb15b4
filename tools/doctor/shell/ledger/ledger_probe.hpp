#pragma once
#include <chrono>
#include <string>

#include "tools/doctor/core/ledger.hpp"
#include "tools/doctor/shell/configs.hpp"

namespace ledgerline::doctor {

/// Asks the peer of a program's config as its identity: configuration, contract, roles and the drones' records. Nothing
/// is written on the ledger. `embedded`: its contract is its own.
Findings ask_ledger(const ProgramConfig& one, const std::string& anchor, bool embedded,
                    const std::vector<std::string>& drones, std::chrono::milliseconds timeout);

}  // namespace ledgerline::doctor
