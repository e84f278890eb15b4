#pragma once
#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "ground/core/flight_view.hpp"
#include "ground/mission/corridor.hpp"
#include "ground/mission/mission.hpp"

namespace ledgerline::ground::mission {

/// What a mission needs to know of a drone that flies here, as FlightCore has it now.
struct DroneNow {
  std::string name;
  GroundPhase phase = GroundPhase::waiting;
  bool seen = false;       ///< a state came from it
  bool on_ground = false;  ///< as its newest state says
  bool paused = false;
  bool held = false;                      ///< its failsafe brakes it: it takes no path now
  std::uint64_t paths = 0;                ///< FlightStatus::paths
  std::size_t reached = 0;                ///< FlightStatus::reached
  std::string why{};                      ///< what went wrong with its flight
  std::optional<Eigen::Vector3d> at_m{};  ///< map; nothing: it has no pose, or its newest is old
  std::optional<double> battery_share{};  ///< 0 to 1
  std::vector<Eigen::Vector3d> way{};     ///< way_of(), of those that check() looks at
};

inline DroneNow drone_now(const FlightView& flights, std::size_t drone) {
  const FlightStatus& status = flights.status(drone);
  const IntakeState& seen = flights.intake(drone);
  const StateSample& state = seen.state;
  DroneNow now{flights.drones()[drone].name,
               status.phase,
               seen.has_state,
               seen.has_state && is_on_ground(state.phase),
               status.paused,
               seen.has_state && state.mode == FailsafeMode::brake,
               status.paths,
               status.reached,
               status.why};
  const bool has_pose = seen.has_state && state.pose_stamp_ns > 0 &&
                        state.stamp_ns - state.pose_stamp_ns <= flights.config().controller.pose_lost_ns;
  if (has_pose) now.at_m = Eigen::Vector3d::Map(state.position_m.data());
  if (seen.has_state && state.sdk_state_fresh && state.battery >= 0)
    now.battery_share = static_cast<double>(state.battery);
  return now;
}

/// Of all drones of the flight, in its order.
inline std::vector<DroneNow> drones_now(const FlightView& flights) {
  std::vector<DroneNow> all;
  for (std::size_t i = 0; i < flights.drones().size(); ++i) all.push_back(drone_now(flights, i));
  return all;
}

/// Corners of the path that a drone flies or has paused. It may be long, and a flight's step has no use for it.
inline std::vector<Eigen::Vector3d> way_of(const FlightView& flights, std::size_t drone) {
  std::vector<Eigen::Vector3d> way;
  for (const auto& corner : flights.status(drone).planned) way.push_back(Eigen::Vector3d::Map(corner.data()));
  return way;
}

/// The box that link keeps its drones in, in the map: what [fence] of link.toml says.
struct Fence {
  std::array<double, 3> min_m{-20, -20, 0};
  std::array<double, 3> max_m{20, 20, 3};
};
/// "4, 0, 1 m is beyond the fence: ..."; empty: it is within.
std::string fence_problem(const Fence& fence, const Eigen::Vector3d& at_m);

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
/// - battery: (takeoff_s + the timetable's time + height at the end / landing_mps) / battery_endurance_s
///   + battery_reserve of it must be there. A hovering multirotor needs about as much power as a slow one (Leishman:
///   Principles of Helicopter Aerodynamics, 5.5), so time alone counts;
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
