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

/// The highest table's top below a position, or the floor's 0.
double floor_height_m(const Parameters& parameters, const Vector& position);

/// The height that the flight controller flies by, from its own sensors: what tof measures, so that it may
/// climb over a table (ControlParameters::follows_floor); where tof measures nothing, the barometer and its drift. One
/// thread.
class OwnHeight {
 public:
  explicit OwnHeight(const Parameters& parameters) : p_(parameters) {}
  /// Every millisecond; above where it took off, as far as it knows.
  double step(const Body& body, const Sensing& sensing);
  void reset() { error_m_ = 0; }

 private:
  Parameters p_;
  double error_m_ = 0;
};

/// Where the drone takes itself to be, by its onboard sensors: what its flight controller flies by. One thread.
class Odometry {
 public:
  Odometry(const Parameters& parameters, std::uint64_t seed) : flow_(parameters.sensors, seed), height_(parameters) {}
  /// Every millisecond.
  void step(const Body& body, const Sensing& sensing);
  /// It takes off: here it knows how high it is.
  void reset_height() { height_.reset(); }

  const Flow& flow() const { return flow_; }
  const Vector& velocity() const { return flow_.velocity(); }
  const Vector& position() const { return position_; }
  double yaw_rad() const { return yaw_rad_; }          ///< unwrapped
  double flow_lost_s() const { return flow_lost_s_; }  ///< for so long without a break

 private:
  Flow flow_;
  OwnHeight height_;
  Vector position_ = Vector::Zero();
  double yaw_rad_ = 0, flow_lost_s_ = 0;
};

}  // namespace ledgerline::sim
