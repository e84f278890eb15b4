#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/msg/names.hpp"
#include "common/rt/clock.hpp"
#include "ground/core/controller.hpp"
#include "sim/core/parameters.hpp"
#include "tools/deployment/deployment.hpp"
#include "tools/deployment/own_drones.hpp"

namespace ledgerline::launcher {

using Ledger = deployment::LedgerKind;

/// What one drone flies in the place of the flight's course.
struct DroneTask {
  ground::Task course;
  std::string file;  ///< of its waypoints, absolute; empty: a shape
};

struct Options {
  ground::Shape shape = ground::Shape::square;
  std::string course_file;                  ///< a path of one's own, absolute; empty: the shape
  std::vector<ground::Waypoint> waypoints;  ///< of that file
  double side_m = 1.5;                      ///< of the shape
  std::map<int, DroneTask> tasks{};         ///< by number, from 1
  std::string pose = "mocap";               ///< link's pose.source, or "none": by hand alone, without poses
  std::vector<sim::Pad> pads{};             ///< that lie on the simulated floor; with any the source is "pads"
  bool manual = false;                      ///< no path: a pilot flies, by ROS 2 topics
  bool predict = true;                      ///< false: the plain controller: newest state, newest command
  std::string controller;                   ///< file: a plug-in that steers in ground's place; empty: none
  ground::Ramp ramp;
  TimeNs max_age_ns = 0;  ///< agent and link take no older command; 0: their defaults, longer on a slow ledger
  int drones = 1;
  std::optional<deployment::OwnDrones> own;  ///< that are there already; none: simulated ones are started
  double rate_hz = 30;
  double speed_mps = 0.5;
  int laps = 3;
  double seconds = 0;  ///< > 0: instead of laps; manual: until it lands and ends; 0: until Ctrl-C
  Ledger ledger = Ledger::embedded;
  int orderers = 1;              ///< of Fabric: 1 or 3
  bool tmpfs = false;            ///< the ledger in memory, gone after the flight
  bool ca = false;               ///< Fabric's identities come from fabric-ca
  bool gateway = false;          ///< transactions through the gateway, not the direct path
  bool endorser = false;         ///< Fabric: the drones' organisation has an endorser of its own beside its peer
  bool endorser_within = false;  ///< the same within agent, which serves ground, too; the embedded ledger's way
  std::string blocks = "peer";   ///< agent's and ground's ledger.blocks
  TimeNs batch_timeout_ns = 10 * ns_per_ms;
  int batch_count = 1;
  bool shim = false;            ///< simulated drones are reached through shared memory in place of UDP (docs/faults.md)
  bool proxy = false;           ///< drones and ledger are reached through ledgerline hil proxy
  bool watch = false;           ///< ground serves its page (docs/station.md)
  bool fault_switches = false;  ///< of the proxy, at that page
  bool open = false;            ///< in the browser
  std::string listen;           ///< the page's address for other devices, with TLS; empty: this computer alone
  std::vector<std::string>
      operators{};           ///< who sign in there with keys of their own; none: ground's identity signs all
  int approvals = 1;         ///< of different operators, before a mission starts: 1 or 2
  std::string faults;        ///< file of what the proxy switches when; empty: none
  std::string cyclonedds;    ///< file of Cyclone DDS's own configuration; empty: DDS stays on this machine
  std::string ros_release;   ///< ROS 2's on this machine; empty: ROS_DISTRO says it
  std::vector<int> domains;  ///< of DDS: that of sim and agent, that of ground; empty: ROS_DOMAIN_ID, else 0
  std::uint64_t seed = 1;
  std::string json;                  ///< file; empty: none
  std::string out;                   ///< directory of the run; empty: chosen by the time
  std::vector<std::string> notes{};  ///< on what was given, for the person who flies
};

/// Motion capture is simulated.
inline bool uses_mocap(const Options& options) {
  const auto source = from_name<link::PoseSource>(options.pose);
  return source && link::uses_mocap(*source);
}

/// Of drone 1, 2 ...
inline std::string drone_name(const Options& options, int drone) {
  return options.own ? options.own->drones[static_cast<std::size_t>(drone) - 1].name : "tello" + std::to_string(drone);
}

/// Of Fabric on this host: no peer is waited for in flight, since agent and ground endorse by themselves and take the
/// orderer's blocks. Otherwise even a peer of another organisation is: two that are not equally far do not agree on an
/// answer, as the calls of several organisations need it. An endorser beside agent follows the own peer.
inline bool waits_for_no_peer(const Options& options) { return options.endorser_within && options.blocks == "ordered"; }

inline std::vector<std::string> drone_names(const Options& options) {
  std::vector<std::string> names;
  for (int k = 1; k <= options.drones; ++k) names.push_back(drone_name(options, k));
  return names;
}

/// Who says where the drones are; "none": nobody, and a pilot flies them without.
inline const std::string& pose_of(const Options& options) {
  return options.own ? options.own->pose_source : options.pose;
}

inline std::string shape_name(const Options& options) {
  if (!options.waypoints.empty()) return "waypoints";
  return options.manual ? "manual" : ground::name_of(options.shape);
}

/// What drone 1, 2 ... flies.
inline DroneTask task_of(const Options& options, int drone) {
  if (const auto own = options.tasks.find(drone); own != options.tasks.end()) return own->second;
  return {{options.shape, options.side_m, options.waypoints, options.speed_mps, options.laps}, options.course_file};
}

/// As it is asked for, sharp corners and all, from this origin.
inline ground::Path path_of(const Options& options, int drone, const Eigen::Vector2d& origin) {
  return {ground::waypoints_of(task_of(options, drone).course), origin};
}

/// The ledger is a network that runs already.
inline bool is_of_others(const Options& options) { return options.own && options.own->network; }

/// The program that is the ledger, and the name of its process; empty: none is started.
inline std::string ledger_program(const Options& options) {
  return options.ledger == Ledger::none || is_of_others(options) ? ""
         : options.ledger == Ledger::fabric                      ? "fabric"
                                                                 : "node";
}
/// The program that flies: ground, or beside the driver.
inline std::string controller_program(const Options& options) {
  return options.ledger == Ledger::none ? "local" : "ground";
}
/// What must be free where the ledger will be. Fabric's orderers make files of 64 MB beforehand and keep some; a disk
/// that fills in flight is survived (docs/ledger.md).
inline std::uint64_t min_ledger_bytes(const Options& options) {
  constexpr std::uint64_t node = 128'000'000, fabric = 100'000'000, orderer = 400'000'000;
  if (ledger_program(options).empty()) return 0;
  return options.ledger == Ledger::fabric ? fabric + static_cast<std::uint64_t>(options.orderers) * orderer : node;
}

/// What the command line asks for: a flight, or a text to print and an exit code.
struct ParsedOptions {
  Options options;
  bool fly = false;
  int exit_code = 0;
  std::string text;  ///< help or version (exit code 0), or what is wrong (2)
};
ParsedOptions parse_command_line(const std::vector<std::string>& arguments);

/// "10ms", "2s", "0.5s", or a plain number of milliseconds; more than nothing, at most a minute.
Result<TimeNs> parse_duration(const std::string& text);

}  // namespace ledgerline::launcher
