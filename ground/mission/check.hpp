#pragma once
#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ground/mission/corridor.hpp"
#include "ground/mission/drone_now.hpp"
#include "ground/mission/mission.hpp"

namespace ledgerline::ground::mission {

/// The box that link keeps its drones in, in the map: what [fence] of link.toml says.
struct Fence {
  std::array<double, 3> min_m{-20, -20, 0};
  std::array<double, 3> max_m{20, 20, 3};
};

struct CheckConfig {
  ControllerConfig flight{};     ///< as the drones will be flown: speed, height, limits
  std::optional<Fence> fence{};  ///< nothing: not known here, which is a warning
  Apart apart{};
  /// A full battery in the air: 13 min, as the maker says of a Tello (docs/sources.md). 60 to 1,800.
  double battery_endurance_s = 780;
  /// Of a full battery, kept at the end: below 20 % a Tello's voltage sags, and what is left goes 1.5 times as fast.
  double battery_reserve = 0.2;
  double start_near_m = 0.5;      ///< so far from its place a drone may stand; as far as two must be from each other
  double takeoff_height_m = 1.0;  ///< where a take-off ends: 0.8 to 1 m of a Tello
  double takeoff_s = 10;  ///< until all hover: a take-off takes 4 s, and they get the command one block after another
  double landing_mps = 0.5;
};

struct Finding {
  std::string drone;                      ///< empty: of the whole mission
  std::optional<std::size_t> waypoint{};  ///< from 0
  std::string words;                      ///< complete, with both
  bool forbids = true;                    ///< the mission is not started; else a warning
};

/// What speaks against the mission as the drones stand and hover now; empty: nothing. Those of `now` that have no part
/// in it keep their place, or are anywhere on the path that they fly. `max_findings` at most, the last one then says
/// that there are more.
///
/// - bounds (check_bounds), names, phases, poses and starts; each waypoint within motion::max_distance_m of where its
///   drone is, and of every other one, since a pause may end anywhere between them;
/// - fence: each waypoint and each start in it, so each way between them, too;
/// - battery: (takeoff_s + the timetable's time + height at the end / landing_mps) / battery_endurance_s +
/// battery_reserve
///   of it must be there. A hovering multirotor needs about as much power as a slow one (Leishman: Principles of
///   Helicopter Aerodynamics, 5.5), so time alone counts;
/// - corridors: each pair of drones apart at all times (Corridor). Where they stand counts, with the column up to
///   takeoff_height_m; the way from there, and where they hover or land at the end.
///
/// Bounded: 64 drones with 500 waypoints each take 0.4 s. Drones that are close to each other for long take longer, to
/// max_visits, when the check ends with a finding that forbids the start. Pure; any thread.
std::vector<Finding> check(const Mission& mission, const CheckConfig& config, std::span<const DroneNow> now);

inline constexpr std::size_t max_findings = 200;
/// Of pairs of nodes (Corridor::meets): about 30 ns each, so 0.6 s in all.
inline constexpr std::size_t max_visits = 20'000'000;

/// Whether one of them forbids the start.
bool forbids(std::span<const Finding> findings);

}  // namespace ledgerline::ground::mission
