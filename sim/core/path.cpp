#include "sim/core/path.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace ledgerline::sim {

SpeedProfile::SpeedProfile(double length, double speed, double acceleration)
    : length_(length), acceleration_(acceleration), top_(std::min(speed, std::sqrt(length * acceleration))) {
  if (length <= 0) return;
  ramp_ = top_ / acceleration;
  duration_ = ramp_ + length / top_;
}

SpeedProfile::At SpeedProfile::at(double t) const {
  if (t <= 0) return {};
  if (t >= duration_) return {length_, 0, 0};
  if (t < ramp_) return {acceleration_ * t * t / 2, acceleration_ * t, acceleration_};
  const double left = duration_ - t;
  if (left < ramp_) return {length_ - acceleration_ * left * left / 2, acceleration_ * left, -acceleration_};
  return {top_ * (t - ramp_ / 2), top_, 0};
}

Path Path::line(const Vector& start, const Vector& offset) {
  Path path;
  path.start_ = start;
  path.length_ = offset.norm();
  path.direction_ = path.length_ > 0 ? Vector(offset / path.length_) : Vector(Vector::Zero());
  path.radius_ = std::numeric_limits<double>::infinity();
  return path;
}

std::optional<Path> Path::arc(const Vector& start, const Vector& via, const Vector& end) {
  // Circumcentre of the triangle (0, via, end).
  const Vector normal = via.cross(end);
  const double area = normal.squaredNorm();
  if (area < 1e-9) return std::nullopt;
  const Vector centre = (via.squaredNorm() * end - end.squaredNorm() * via).cross(normal) / (2 * area);
  Path path;
  path.start_ = start + centre;
  path.radius_ = centre.norm();
  path.direction_ = -centre / path.radius_;
  // Around the normal of (0, via, end) the points come in this order: start, via, end.
  path.across_ = normal.normalized().cross(path.direction_);
  const Vector last = end - centre;
  double angle = std::atan2(last.dot(path.across_), last.dot(path.direction_));
  if (angle < 0) angle += 2 * std::numbers::pi;
  path.length_ = angle * path.radius_;
  return path;
}

Path::Point Path::at(double distance) const {
  if (!std::isfinite(radius_)) return {start_ + direction_ * distance, direction_};
  const double angle = distance / radius_;
  const Vector outward = std::cos(angle) * direction_ + std::sin(angle) * across_;
  const Vector tangent = std::cos(angle) * across_ - std::sin(angle) * direction_;
  return {start_ + radius_ * outward, tangent, -outward / radius_};
}

}  // namespace ledgerline::sim
