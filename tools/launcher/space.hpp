#pragma once
#include <cstdint>

#include "tools/launcher/options.hpp"

namespace ledgerline::fly {

/// How long a flight is expected to take, with take-off and landing.
double expected_seconds(const Options& options);

/// What the ledger of a flight will take on its file system, with a margin of a half: measured growth, times the
/// flight.
std::uint64_t expected_ledger_bytes(const Options& options);

}  // namespace ledgerline::fly
