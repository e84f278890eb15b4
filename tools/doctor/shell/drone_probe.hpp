#pragma once
#include "tools/doctor/core/finding.hpp"
#include "tools/doctor/shell/configs.hpp"

namespace ledgerline::doctor {

/// Asks each drone of link's config for its battery. Nothing is sent while link runs.
Findings ask_drones(const ProgramConfig& link);

}  // namespace ledgerline::doctor
