#pragma once
#include <Eigen/Core>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"
#include "ground/motion/waypoints.hpp"

/// Missions: several drones, a path each, flown together (docs/station.md). All of this is without I/O.
namespace ledgerline::ground::mission {

using motion::max_coordinate_m;
using motion::Waypoint;

inline constexpr std::size_t max_drones = 64;
inline constexpr std::size_t max_name = 64;  ///< characters of a mission's and a drone's name
/// Of a mission as text. 64 drones of 500 waypoints, each number with all its 17 digits, are 3.4 MB.
inline constexpr std::size_t max_mission_bytes = 4'194'304;

struct MissionDrone {
  std::string drone;
  std::optional<Eigen::Vector2d> start_m{};  ///< where it is to stand or hover; nothing: wherever it does
  std::vector<Waypoint> waypoints{};         ///< metres of the map; no height or speed: the drone's, then the flight's
  bool land_behind = false;                  ///< lands at the end, else hovers there
  std::optional<double> speed_mps{};         ///< of waypoints that say none

  /// With the drone's speed where one says none.
  std::vector<Waypoint> way() const;
};

struct Mission {
  std::string name;
  std::vector<MissionDrone> drones;  ///< their order says nothing
};

void sort_by_name(Mission& mission);

/// 1 to 64 of A-Z, a-z, 0-9, "_" and "-".
bool is_name(std::string_view text);

/// What every mission must satisfy, no matter who made it: names, counts, coordinates, heights, speeds; no drone twice.
/// What depends on where the drones are is check()'s. The error names drone and waypoint, counted from 1.
Status check_bounds(const Mission& mission);

/// One text for each mission, which mission_from_json() reads: keys and drones in a fixed order, each number as short
/// as it may be to be read as the same. Of a mission that check_bounds() allows.
std::string canonical(const Mission& mission);

/// SHA-256 of that text: what is approved. Equal for equal missions, however they were written.
crypto::Digest digest(const Mission& mission);

// Missions from outside, max_mission_bytes at most. Read strictly: what is returned keeps to check_bounds(); an error
// names the line, or drone and waypoint. Pure; any thread.

/// {"name":"survey","drones":[{"drone":"tello1","start":{"x":0,"y":0},"speed":0.5,
///   "waypoints":[{"x":1,"y":0,"z":1.2,"speed":0.5}],"then":"land"}]}; start, speed, z and then ("hover") may be
///   missing.
Result<Mission> mission_from_json(std::string_view text);

/// The same, already parsed: of a document that has a mission in it.
Result<Mission> mission_from_document(const nlohmann::json& given);

/// A heading `drone,x,y,z,speed` or `drone,x,y,z,speed,then`, then a line for each waypoint in its drone's order; the
/// drones' lines may be mixed. z, speed and then may be empty; `then` of any of a drone's lines holds for the drone.
/// `#` begins a comment. A file has no name for the mission: `name`. `file`: errors begin with it and the line, as
/// those of motion::path_from_csv(); empty: with the line alone.
Result<Mission> mission_from_csv(std::string_view text, const std::string& name, const std::string& file = "");

}  // namespace ledgerline::ground::mission
