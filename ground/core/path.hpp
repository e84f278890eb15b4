#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "ground/motion/waypoints.hpp"

namespace ledgerline::ground {

using motion::name_of;
using motion::Shape;
using motion::shape_from_name;
using motion::Waypoint;

/// What one drone flies.
struct Task {
  Shape shape = Shape::square;
  double side_m = 1.5;
  std::vector<Waypoint> waypoints{};  ///< of a path of one's own; empty: the shape
  double speed_mps = 0.5;
  int laps = 3;
};
std::vector<Waypoint> waypoints_of(const Task& task);

/// A closed polygon in the horizontal plane, metres in the map frame: what cross-track errors are measured against,
/// with its corners sharp; its waypoints' heights and speeds along with it. It begins and ends at its first corner, the
/// origin. Immutable; any thread.
class Path {
 public:
  Path(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin);
  Path(Shape shape, const Eigen::Vector2d& origin, double side_m) : Path(motion::waypoints_of(shape, side_m), origin) {}

  double length_m() const { return starts_m_.back(); }
  /// Arc length of a corner.
  double length_to(std::size_t corner) const { return starts_m_.at(corner); }
  /// Without the origin repeated at the end.
  const std::vector<Eigen::Vector2d>& corners() const { return corners_; }
  /// At arc length `s_m` from the origin; any number, laps are taken off.
  Eigen::Vector2d point(double s_m) const;
  /// Unit vector of the direction of travel; at a corner that of the piece that begins there.
  Eigen::Vector2d direction(double s_m) const;
  /// At that arc length, on the line between its piece's ends; `otherwise_m` where a waypoint says none.
  double height_m(double s_m, double otherwise_m) const;
  /// Climb per metre of the piece there.
  double climb(double s_m, double otherwise_m) const;
  /// The limit of the piece there; nothing: its waypoint says none.
  std::optional<double> speed_mps(double s_m) const;
  /// Distance to the nearest point of the whole path: the cross-track error.
  double distance_m(const Eigen::Vector2d& p) const;

 private:
  std::size_t piece_at(double& s_m) const;

  std::vector<Waypoint> waypoints_;  ///< for their heights and speeds
  std::vector<Eigen::Vector2d> corners_;
  std::vector<double> starts_m_;  ///< arc length of each corner, then of the end
};

}  // namespace ledgerline::ground
