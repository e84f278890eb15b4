#pragma once
#include <array>
#include <cmath>
#include <vector>

#include "ground/core/follower.hpp"

namespace ledgerline::ground {

constexpr double near_m = 0.2;  ///< of a place: close enough to call it reached
constexpr double still_mps = 0.2;

/// Near this place of the map, and no longer on its way.
inline bool is_settled(const StateSample& state, const std::array<double, 3>& place_m) {
  return std::hypot(state.position_m[0] - place_m[0], state.position_m[1] - place_m[1]) < near_m &&
         std::abs(state.position_m[2] - place_m[2]) < near_m &&
         std::hypot(state.velocity_mps[0], state.velocity_mps[1], state.velocity_mps[2]) < still_mps;
}

/// A path that a pilot gave a drone in the air: what its follower flies, where it ends, and what is left of it when it
/// is paused. One thread.
class PilotPath {
 public:
  /// From `here` on through `way` (check_way() allows it; metres of the map); `height_m`: of waypoints that say none.
  PilotPath(std::vector<Waypoint> way, bool land_behind, const Waypoint& here, double height_m);

  const motion::OpenPath& course() const { return course_; }
  bool land_behind() const { return land_behind_; }
  /// As far as its follower shall fly.
  double end_m(const Follower& follower) const { return follower.length_to(course_.last); }
  /// A state in flight: looks which waypoints the drone has reached.
  void observe(const Follower& follower, const StateSample& state);
  /// Settled at its last waypoint.
  bool at_end(const Follower& follower, const StateSample& state) const;
  /// Waypoints, from the first on; without the last one until the path ends.
  std::size_t reached() const { return next_; }
  /// The waypoints not reached yet; the last one is among them until the path ends.
  std::vector<Waypoint> rest() const;
  /// From where it began; map frame.
  std::vector<std::array<double, 3>> corners() const;

 private:
  std::vector<Waypoint> way_;
  bool land_behind_;
  Waypoint here_;
  motion::OpenPath course_;
  std::size_t next_ = 0;  ///< the first one of the way that was not reached yet
};

}  // namespace ledgerline::ground
