#pragma once
#include "tools/doctor/core/finding.hpp"
#include "tools/doctor/shell/configs.hpp"

namespace ledgerline::doctor {

/// Asks each drone of link's config for its battery, and hears whether its state texts come. Nothing is sent while link
/// runs.
Findings ask_drones(const ProgramConfig& link);

/// Listens for some seconds, as agent does, for poses of those of link's drones that fly by motion capture.
Findings hear_poses(const ProgramConfig& link, const ProgramConfig& agent);

}  // namespace ledgerline::doctor
