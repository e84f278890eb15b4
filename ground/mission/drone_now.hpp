#pragma once
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "ground/core/flight_view.hpp"

namespace ledgerline::ground::mission {

/// What a mission needs to know of a drone that flies here, as FlightCore has it now.
struct DroneNow {
  std::string name;
  DronePhase phase = DronePhase::waiting;
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

inline DroneNow drone_now(const FlightView& core, std::size_t drone) {
  const FlightStatus& status = core.status(drone);
  const IntakeState& seen = core.seen(drone);
  const StateSample& state = seen.state;
  DroneNow now{core.drones()[drone].name,
               status.phase,
               seen.has_state,
               seen.has_state && on_ground(state.phase),
               status.paused,
               seen.has_state && state.mode == FailsafeMode::brake,
               status.paths,
               status.reached,
               status.why};
  const bool has_pose = seen.has_state && state.pose_stamp_ns > 0 &&
                        state.stamp_ns - state.pose_stamp_ns <= core.config().controller.pose_lost_ns;
  if (has_pose) now.at_m = Eigen::Vector3d::Map(state.position_m.data());
  if (seen.has_state && state.sdk_state_fresh && state.battery >= 0)
    now.battery_share = static_cast<double>(state.battery);
  return now;
}

/// Of all drones of the flight, in its order.
inline std::vector<DroneNow> drones_now(const FlightView& core) {
  std::vector<DroneNow> all;
  for (std::size_t i = 0; i < core.drones().size(); ++i) all.push_back(drone_now(core, i));
  return all;
}

/// Corners of the path that a drone flies or has paused. It may be long, and a flight's step has no use for it.
inline std::vector<Eigen::Vector3d> way_of(const FlightView& core, std::size_t drone) {
  std::vector<Eigen::Vector3d> way;
  for (const auto& corner : core.status(drone).planned) way.push_back(Eigen::Vector3d::Map(corner.data()));
  return way;
}

}  // namespace ledgerline::ground::mission
