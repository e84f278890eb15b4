#pragma once
#include <chrono>
#include <vector>

#include "tools/checks/shell/configs.hpp"
#include "tools/status/core/status.hpp"

/// Looks at this host and asks the peers of its configs. Changes nothing; nothing is written on the ledger.
namespace ledgerline::status {

/// The programs of ours that run on this host, as far as this user may look at them (root: all); by name and pid.
std::vector<Program> running_programs();

/// The services' configs that none of these programs runs by.
std::vector<NotRunning> not_running(const checks::Configs& configs, const std::vector<Program>& programs);

/// What the peers of a program's config say of its channel and drones, asked as its identity; `one.ledger` is there.
/// Waits `timeout` at most for each answer.
Ledger query_ledger(const checks::ProgramConfig& one, std::chrono::milliseconds timeout);

}  // namespace ledgerline::status
