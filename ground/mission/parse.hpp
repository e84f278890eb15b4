#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "ground/mission/mission.hpp"

/// Missions from outside, max_mission_bytes at most. Read strictly: what is returned keeps to check_bounds(); an error
/// names the line, or drone and waypoint. Pure; any thread.
namespace ledgerline::ground::mission {

/// {"name":"survey","drones":[{"drone":"tello1","start":{"x":0,"y":0},"speed":0.5,
///   "waypoints":[{"x":1,"y":0,"z":1.2,"speed":0.5}],"then":"land"}]}; start, speed, z and then ("hover") may be
///   missing.
Result<Mission> mission_from_json(std::string_view text);

/// The same, already parsed: of a document that has a mission in it.
Result<Mission> mission_from_json(const nlohmann::json& given);

/// A heading `drone,x,y,z,speed` or `drone,x,y,z,speed,then`, then a line for each waypoint in its drone's order; the
/// drones' lines may be mixed. z, speed and then may be empty; `then` of any of a drone's lines holds for the drone.
/// `#` begins a comment. A file has no name for the mission: `name`.
Result<Mission> mission_from_csv(std::string_view text, const std::string& name);

}  // namespace ledgerline::ground::mission
