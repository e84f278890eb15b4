#pragma once
#include <utility>

#include "common/base/random.hpp"
#include "ground/mission/check.hpp"

/// Drones and missions that tests begin with.
namespace ledgerline::ground::mission {

inline Waypoint at(double x, double y, double z = 1, std::optional<double> speed = {}) { return {{x, y}, z, speed}; }

inline MissionDrone flown_by(std::string drone, std::vector<Waypoint> way, bool land_behind = false) {
  return {std::move(drone), {}, std::move(way), land_behind, {}};
}

/// Stands there with a full battery.
inline DroneNow standing(std::string name, double x, double y) {
  DroneNow now{std::move(name)};
  now.seen = now.on_ground = true;
  now.at_m = Eigen::Vector3d(x, y, 0);
  now.battery_share = 1;
  return now;
}

inline DroneNow hovering(std::string name, double x, double y, double z = 1) {
  DroneNow now = standing(std::move(name), x, y);
  now.on_ground = false;
  now.phase = GroundPhase::manual;
  now.at_m->z() = z;
  return now;
}

inline double between(Random& random, double least, double most) { return least + (most - least) * random.uniform(); }
inline std::uint64_t below(Random& random, std::uint64_t end) { return random.next() % end; }

}  // namespace ledgerline::ground::mission
