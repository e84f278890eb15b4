#pragma once
#include <chrono>

#include "tools/doctor/shell/configs.hpp"
#include "tools/status/core/status.hpp"

namespace ledgerline::status {

/// What the peers of a program's config say of its channel and drones, asked as its identity; `one.ledger` is there.
/// Waits `timeout` at most for each answer. Nothing is written on the ledger.
Ledger ask_ledger(const doctor::ProgramConfig& one, std::chrono::milliseconds timeout);

}  // namespace ledgerline::status
