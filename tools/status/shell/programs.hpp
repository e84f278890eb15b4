#pragma once
#include <vector>

#include "tools/status/core/process.hpp"

namespace ledgerline::status {

/// The programs of ours that run on this host, as far as this user may look at them (root: all); by name and pid.
/// Changes nothing.
std::vector<Program> running_programs();

}  // namespace ledgerline::status
