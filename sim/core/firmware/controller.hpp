#pragma once
#include <optional>

#include "sim/core/parameters.hpp"
#include "sim/core/world.hpp"

namespace ledgerline::sim {

/// What the flight controller shall fly, in the map frame.
struct VelocitySetpoint {
  Vector velocity = Vector::Zero();      ///< [m/s]
  Vector acceleration = Vector::Zero();  ///< known in advance (moves along a path); zero for sticks [m/s2]
  double yaw_rate = 0;                   ///< counter-clockwise [rad/s]
};

/// Velocity -> acceleration (first order, limited) -> thrust and attitude -> torque: the cascade of every small
/// quadrotor (Mellinger and Kumar 2011 without the differential flatness). Pure.
Motors fly_velocity(const Parameters& parameters, const Body& body, const Vector& estimated_velocity,
                    const VelocitySetpoint& setpoint);

/// Attitude mode: sideways the setpoint's velocity is a lean, as full a one as SdkParameters::rc_full_mps is full, and
/// nothing slows the drone but the air; upward as fly_velocity. Pure.
Motors fly_attitude(const Parameters& parameters, const Body& body, const Vector& estimated_velocity,
                    const VelocitySetpoint& setpoint);

/// A body rate instead of an attitude: for flips.
Motors fly_rates(const Parameters& parameters, const Body& body, const Vector& rates, double thrust_by_weight);

/// How the flight controller stays where it is while the sticks are centred: sideways by vision (its odometry), upward
/// by its own height. Each of both takes a position to hold as soon as the drone is about at rest, and sideways at the
/// latest after ControlParameters::hold_after_s, so that wind does not carry it away for ever; an integral learns what
/// pushes. One thread.
class PlaceHold {
 public:
  explicit PlaceHold(const ControlParameters& parameters) : p_(parameters) {}

  void release();
  void release_sideways();
  void hold(const Eigen::Vector2d& position);
  void hold_height(double height_m);
  /// Moves the position that it holds sideways, where it holds one.
  void shift(const Eigen::Vector2d& by);

  /// Every millisecond: the velocity to fly. `wanted` is what the sticks say; where it is zero, the position is held.
  Eigen::Vector2d sideways(const Eigen::Vector2d& wanted, const Vector& position, const Vector& velocity);
  double upward(double wanted_mps, const Vector& position, const Vector& velocity);

  /// Where it holds or held last, for a flip's return: valid after hold() and hold_height().
  Vector position() const;

 private:
  ControlParameters p_;
  std::optional<Eigen::Vector2d> position_;
  std::optional<double> height_m_;
  Eigen::Vector2d learned_mps_ = Eigen::Vector2d::Zero();
  double learned_up_mps_ = 0;
  double centred_s_ = 0;
};

}  // namespace ledgerline::sim
