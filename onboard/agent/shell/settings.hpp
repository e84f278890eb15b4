#pragma once
#include <string>
#include <vector>

#include "common/bridge/core/rules.hpp"
#include "common/config/config.hpp"
#include "common/fabric/channels.hpp"
#include "common/msg/ros.hpp"
#include "onboard/agent/core/agent_core.hpp"

namespace ledgerline::agent {

/// Everything of agent.toml but [ledger] and [[msp]], which common/fabric reads.
struct Settings {
  AgentCoreSettings core;
  std::string trace;            ///< file; empty: none
  std::string summary;          ///< file; empty: none
  TimeNs status_period_ns = 0;  ///< 0: none
  std::string mocap_topic;      ///< "{drone}" stands for the drone's name; empty: no mocap
  PoseMessage mocap_message = PoseMessage::pose_stamped;
  bool mocap_stamps_are_of_this_host = true;  ///< else the time of arrival counts
  TimeNs start_wait_ns = 15 * ns_per_s;       ///< for RouDi and the ledger, each
  std::string checkpoint;                     ///< file of the newest block verified; empty: none
  std::uint64_t max_absence_blocks = 1'000;   ///< behind it that are read one by one
  TimeNs recheck_ns = 5 * ns_per_s;           ///< between two looks at another organisation's records; 0: never
  bool blocks_are_validated = false;          ///< config_block is set
  int priority = 0;  ///< SCHED_FIFO of the threads between a block and its plans; 0: ordinary. Below link's (80)
};

/// Asks for all keys; config.finish() then says what is wrong. `msp_id`: our own organisation.
Settings read_settings(Config& config, const std::string& msp_id, const fabric::ChannelAndContract& where);

/// The settings of each channel's AgentShell: those of the process with the drones that are on it, its contract, a
/// checkpoint file and a seed of its own. With one channel they are those of the process.
std::vector<Settings> settings_of_channels(const Settings& process, const fabric::Channels& channels);

/// Reads what else agent bridges: topics below its drones' names may be written by it, but for those that it writes of
/// their states and transitions.
bridge::BridgeConfig read_bridge(Config& config, const std::vector<DroneName>& drones);

}  // namespace ledgerline::agent
