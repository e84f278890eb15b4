#pragma once
#include "common/base/random.hpp"
#include "sim/core/parameters.hpp"
#include "sim/core/world.hpp"

namespace ledgerline::sim {

/// The drone's own velocity: optical flow of the camera that looks down, times the height that tof says. Horizontally
/// it has a slow error (Ornstein-Uhlenbeck), a share by which the whole is too large or too small, the same for a
/// drone's whole life (camera and tof are not exact), and what Sensing adds. With too little light or too smooth a
/// floor flow is lost: the velocity then fades to zero, however the drone drifts. Vertically it is right. All of it is
/// assumed: docs/sources.md. One thread.
class Flow {
 public:
  Flow(const SensorParameters& parameters, std::uint64_t seed);

  /// Every millisecond; map frame.
  const Vector& step(const Body& body, const Sensing& sensing);
  const Vector& velocity() const { return velocity_; }
  /// The same as the state text has it: behind by SensorParameters::velocity_lag_s.
  const Vector& reported() const { return reported_; }
  bool lost() const { return lost_; }

 private:
  SensorParameters p_;
  Random random_;
  double scale_error_;
  Vector error_ = Vector::Zero();
  Vector velocity_ = Vector::Zero(), reported_ = Vector::Zero();
  bool lost_ = false;
  int steps_ = 0;
};

}  // namespace ledgerline::sim
