#include "ground/core/path.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ledgerline::ground {

std::vector<Waypoint> waypoints_of(const Task& task) {
  return task.waypoints.empty() ? motion::waypoints_of(task.shape, task.side_m) : task.waypoints;
}

Path::Path(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin)
    : waypoints_(waypoints), starts_m_{0} {
  for (const Waypoint& waypoint : waypoints) corners_.push_back(origin + waypoint.at_m);
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    const auto& next = corners_[(i + 1) % corners_.size()];
    starts_m_.push_back(starts_m_.back() + (next - corners_[i]).norm());
  }
}

// Takes the laps off `s_m` and the start of the piece; says which piece it is on.
std::size_t Path::piece_at(double& s_m) const {
  s_m = std::fmod(s_m, length_m());
  if (s_m < 0) s_m += length_m();
  const auto next = std::upper_bound(starts_m_.begin() + 1, starts_m_.end() - 1, s_m);
  const auto piece = static_cast<std::size_t>(next - starts_m_.begin()) - 1;
  s_m -= starts_m_[piece];
  return piece;
}

Eigen::Vector2d Path::point(double s_m) const {
  const std::size_t i = piece_at(s_m);
  const auto& next = corners_[(i + 1) % corners_.size()];
  return corners_[i] + s_m * (next - corners_[i]).normalized();
}

Eigen::Vector2d Path::direction(double s_m) const {
  const std::size_t i = piece_at(s_m);
  return (corners_[(i + 1) % corners_.size()] - corners_[i]).normalized();
}

double Path::climb(double s_m, double otherwise_m) const {
  const std::size_t i = piece_at(s_m), next = (i + 1) % corners_.size();
  const double rise_m = waypoints_[next].height_m.value_or(otherwise_m) - waypoints_[i].height_m.value_or(otherwise_m);
  return rise_m / (corners_[next] - corners_[i]).norm();
}

double Path::height_m(double s_m, double otherwise_m) const {
  const double slope = climb(s_m, otherwise_m);
  const std::size_t i = piece_at(s_m);
  return waypoints_[i].height_m.value_or(otherwise_m) + s_m * slope;
}

std::optional<double> Path::speed_mps(double s_m) const { return waypoints_[piece_at(s_m)].speed_mps; }

double Path::distance_m(const Eigen::Vector2d& p) const {
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    const Eigen::Vector2d piece = corners_[(i + 1) % corners_.size()] - corners_[i];
    const double along = std::clamp((p - corners_[i]).dot(piece) / piece.squaredNorm(), 0.0, 1.0);
    nearest = std::min(nearest, (p - corners_[i] - along * piece).norm());
  }
  return nearest;
}

}  // namespace ledgerline::ground
