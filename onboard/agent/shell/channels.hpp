#pragma once
#include <vector>

#include "common/fabric/channels.hpp"
#include "onboard/agent/shell/settings.hpp"

namespace ledgerline::agent {

/// The settings of each channel's AgentShell: those of the process with the drones that are on it, its contract, a
/// checkpoint file and a seed of its own. With one channel they are those of the process.
std::vector<Settings> settings_of_channels(const Settings& process, const fabric::Channels& channels);

}  // namespace ledgerline::agent
