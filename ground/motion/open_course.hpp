#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "ground/motion/course.hpp"

namespace ledgerline::motion {

/// A path with an end, as the closed one that Path and Track take. The closing pieces leave its last waypoint straight
/// on and come to its first corner straight on, so that neither is rounded: the way begins and ends at these places
/// themselves. Its follower stops at the arc length of corner `last`; the closing pieces are never flown.
///
///     before --> here --> way[0] --> ... --> way[n-1] --> behind
///        ^                                                  |
///        +--------------------------------------------------+
struct OpenCourse {
  std::vector<Waypoint> waypoints;  ///< of the closed path; metres from `origin_m`
  Eigen::Vector2d origin_m = Eigen::Vector2d::Zero();
  std::size_t first = 0;  ///< the corner that is the way's first waypoint: 0 where `here` is that place, else 1
  std::size_t last = 0;   ///< the corner that is the way's last waypoint
};

/// From `here` through all waypoints of `way` (check_way() allows it), which are in metres of the map. Closer than 1 cm
/// to the first waypoint, the path begins at that. On the way there the first waypoint's own limit of speed holds.
OpenCourse open_course(const Waypoint& here, const std::vector<Waypoint>& way);

}  // namespace ledgerline::motion
