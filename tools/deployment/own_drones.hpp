#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/config/config.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"
#include "onboard/link/core/settings.hpp"
#include "tools/deployment/deployment.hpp"

/// A deployment.toml without [[host]]: drones that are there already, real ones or those of a simulator that somebody
/// else runs, all flown from this computer (docs/fly.md, "Real drones").
namespace ledgerline::deployment {

struct OwnDrone {
  std::string name{};               ///< as it is enrolled
  std::string address{};            ///< IPv4
  std::string interface {};         ///< that it is behind; empty: the routing table says
  std::string serial{};             ///< that it must answer with; empty: any
  std::array<double, 3> start_m{};  ///< where it stands, for its own odometry
  double start_yaw_rad = 0;
};

/// What a flight is, where the command line does not say otherwise.
struct OwnFlight {
  std::string shape = "square";  ///< as --shape: a name, a file of waypoints, manual
  double side_m = 1.5, speed_mps = 0.5;
  int laps = 3;
  std::optional<double> lag_s{};   ///< of the drones' answer to a velocity; none: ground's default, until it is learned
  TimeNs wait_ns = 30 * ns_per_s;  ///< for all drones, before take-off: a real one may be switched on meanwhile
};

/// A network that runs already: TOML of [ledger], [[orderer]] and so on, as it was in the files that were named.
struct OwnLedger {
  std::string agent, ground;  ///< for their configs, with [[msp]]
  std::string pilot;          ///< for ledgerline control as ground's identity, who acquires the drones
  std::string admin;          ///< for ledgerline control as who enrols agent; empty: it is enrolled
  std::string agent_msp_id, ground_msp_id;
  crypto::IdentityFiles agent_files, ground_files;
};

struct OwnDrones {
  std::vector<OwnDrone> drones;
  LedgerKind ledger = LedgerKind::embedded;
  std::optional<OwnLedger> network;  ///< none: the ledger is started
  std::string pose_source;           ///< "mocap", another one that link knows, or "none"
  std::string pose_topic;            ///< of mocap, {drone} for the name; empty: it is not from there
  bool pose_stamps_count = true;     ///< of mocap: its clock is this computer's; false: the time of arrival counts
  std::string
      mocap_table;  ///< TOML, for agent's config, none of it where poses come from elsewhere; empty: its defaults
  std::string link_tables;  ///< TOML: [pose] unless from mocap, [fence], [rc], [limits], for link's config
  link::LinkSettings link;  ///< what these tables say, for what is checked and reported before link reads them
  OwnFlight flight;
};

/// True where the file has no [[host]].
bool is_of_own_drones(Config& config);

/// Every key is checked; what is dangerous has no default: [fence] with both corners, and pose.source. Errors name
/// file, line and key. The tables for link are checked by link's own reader (link_config.hpp). `path`: of the file.
Result<OwnDrones> read_own_drones(Config& config, const std::string& path);

}  // namespace ledgerline::deployment
