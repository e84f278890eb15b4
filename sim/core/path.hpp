#pragma once
#include <optional>

#include "sim/core/world.hpp"

namespace ledgerline::sim {

/// Distance along a path by time: up to speed, along, down to rest again.
class SpeedProfile {
 public:
  SpeedProfile() = default;
  SpeedProfile(double length, double speed, double acceleration);
  struct At {
    double distance = 0, speed = 0, acceleration = 0;
  };
  At at(double t_s) const;
  double duration_s() const { return duration_; }

 private:
  double length_ = 0, acceleration_ = 1, top_ = 0, ramp_ = 0, duration_ = 0;
};

/// Where to be: a straight line or an arc from `start`, in the drone's odometry frame.
class Path {
 public:
  struct Point {
    Vector position, tangent;
    Vector normal_curvature = Vector::Zero();  ///< times speed squared: centripetal acceleration
  };
  static Path line(const Vector& start, const Vector& offset);
  /// Through start + via to start + end. Nothing where the three points lie on one line.
  static std::optional<Path> arc(const Vector& start, const Vector& via, const Vector& end);
  double length() const { return length_; }
  /// Infinite for a line.
  double radius() const { return radius_; }
  Point at(double distance) const;

 private:
  Path() = default;
  Vector start_ = Vector::Zero(), direction_ = Vector::Zero();  // a line; for an arc: centre, and towards its start
  Vector across_ = Vector::Zero();                              // an arc's first tangent
  double length_ = 0, radius_ = 0;
};

}  // namespace ledgerline::sim
