#pragma once
#include <netinet/in.h>

#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/config/config.hpp"
#include "onboard/link/core/settings.hpp"

namespace ledgerline::link {

/// What the shell needs beside the cores' settings.
struct ShellSettings {
  LinkSettings link;
  std::string shim;                     ///< file of the shim's memory, in place of UDP; empty: UDP
  bool lockstep = false;                ///< the shim moves link's clock, and stands in agent's place
  std::vector<sockaddr_in> addresses;   ///< of the drones' command ports, in the order of link.drones; UDP alone
  std::vector<std::string> interfaces;  ///< that each drone is behind, in the same order; empty: wherever routes lead
  std::uint16_t state_port = 8889;      ///< that drones send state text from; 0: any
  sockaddr_in state_listen{};
  std::string trace;        ///< empty: none
  std::string summary;      ///< empty: none
  std::string starts;       ///< remembers link's last starts (persistent_state.hpp); empty: nobody does
  std::string local_stops;  ///< remembers the local stops (persistent_state.hpp); empty: nobody does
  std::int64_t status_period_ms = 0;
  double loop_hz = 1000;
  int priority = 80;                        ///< SCHED_FIFO; 0: ordinary scheduling is wanted
  int cpu = -1;                             ///< -1: any
  TimeNs landing_bound_ns = 10 * ns_per_s;  ///< after SIGTERM
};

/// Reads link's TOML file; every key is checked.
Result<ShellSettings> load_settings(const std::string& path);
/// The same of a file that is open; `path` is for errors.
Result<ShellSettings> read_settings(Config& config, const std::string& path);
/// [limits], [rc] and [fence] alone, of deployment.toml, which says them for a link.toml to come.
void read_bounds(Config& config, LinkSettings& link);

/// What link.toml says of where drones are: [pose], [[pad]], and the keys of [[drone]] that belong to it.
struct PoseSettings {
  PoseSource source = PoseSource::mocap;  ///< of the drones that do not say their own
  OdometrySettings odometry;
  TimeNs odometry_after_ns = DroneSettings{}.odometry_after_ns;
  bool has_signs = false;
  std::vector<PadSettings> pads;
};

PoseSettings read_pose(Config& config);

}  // namespace ledgerline::link
