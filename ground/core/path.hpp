#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "common/rt/result.hpp"

namespace ledgerline::ground {

enum class Shape { square, triangle, x };
Result<Shape> shape_from_name(const std::string& name);
std::string name_of(Shape shape);

/// A closed path of straight pieces in the horizontal plane, metres in the map frame. It begins and ends at its first
/// corner, the origin, and stays in the quadrant x >= 0, y >= 0 from there. The x is the two diagonals of a square,
/// joined by two of its sides, so that it closes without turning back on itself.
///
///     square        triangle        x
///     3 ---- 2         2            3      1
///     |      |        / \           | \  / |
///     |      |       /   \          | /  \ |
///     0 ---- 1      0 --- 1         0      2
///
/// Immutable; any thread.
class Path {
 public:
  Path(Shape shape, Eigen::Vector2d origin, double side_m);

  double length_m() const { return starts_m_.back(); }
  /// Without the origin repeated at the end.
  const std::vector<Eigen::Vector2d>& corners() const { return corners_; }
  /// At arc length `s_m` from the origin; any number, laps are taken off.
  Eigen::Vector2d point(double s_m) const;
  /// Unit vector of the direction of travel; at a corner that of the piece that begins there.
  Eigen::Vector2d direction(double s_m) const;
  /// Distance to the nearest point of the whole path: the cross-track error.
  double distance_m(const Eigen::Vector2d& p) const;

  /// The corner ahead of `s_m` and the one behind it: how far along the path, and by what angle the path turns there
  /// [rad, 0..pi].
  struct Turn {
    double ahead_m, ahead_rad;
    double behind_m, behind_rad;
  };
  Turn turns(double s_m) const;

 private:
  std::size_t piece_at(double& s_m) const;
  double turn_at(std::size_t corner) const;

  std::vector<Eigen::Vector2d> corners_;
  std::vector<double> starts_m_;  ///< arc length of each corner, then of the end
};

}  // namespace ledgerline::ground
