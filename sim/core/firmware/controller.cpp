#include "sim/core/firmware/controller.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::sim {
namespace {

constexpr double rate_loop_s = 0.02;  // [A] the body rates' loop, well above attitude_rad_per_s

Vector limited(const Vector& v, double horizontal, double vertical) {
  Vector out = v;
  const double length = std::hypot(v.x(), v.y());
  if (length > horizontal) out.head<2>() *= horizontal / length;
  out.z() = std::clamp(v.z(), -vertical, vertical);
  return out;
}

// Acceleration -> thrust and attitude -> torque.
Motors fly_force(const Parameters& parameters, const Body& body, Vector force, double wanted_yaw_rate) {
  const ControlParameters& c = parameters.control;
  const BodyParameters& b = parameters.body;
  const double max_sideways = force.z() * std::tan(c.max_tilt_rad);
  const double sideways = std::hypot(force.x(), force.y());
  if (sideways > max_sideways) force.head<2>() *= max_sideways / sideways;

  const Vector up = body.attitude * Vector::UnitZ();
  // Rotation axis times the sine of the angle between the thrust as it is and as it should be, in body axes.
  const Vector error = body.attitude.conjugate() * up.cross(force.normalized());
  const double w = c.attitude_rad_per_s;
  const double yaw_rate = std::clamp(wanted_yaw_rate, -c.max_yaw_rate_radps, c.max_yaw_rate_radps);
  Motors motors;
  motors.thrust_n = std::max(0.0, force.dot(up));
  motors.torque_nm = {
      b.inertia_xy_kgm2 * (w * w * error.x() - 2 * w * body.rates.x()),
      b.inertia_xy_kgm2 * (w * w * error.y() - 2 * w * body.rates.y()),
      b.inertia_z_kgm2 * ((yaw_rate - body.rates.z()) / c.yaw_rate_lag_s + b.drag_angular_per_s * body.rates.z())};
  return motors;
}

}  // namespace

Motors fly_velocity(const Parameters& parameters, const Body& body, const Vector& estimated_velocity,
                    const VelocitySetpoint& setpoint) {
  const ControlParameters& c = parameters.control;
  const BodyParameters& b = parameters.body;
  const Vector wanted = limited(setpoint.velocity, c.max_speed_mps, c.max_speed_mps);
  const Vector acceleration = limited(setpoint.acceleration + (wanted - estimated_velocity) / c.velocity_lag_s,
                                      c.max_acceleration_mps2, c.max_vertical_mps2);
  // Drag in still air is known to the controller; gusts are not.
  const Vector drag(b.drag_xy_per_s * estimated_velocity.x(), b.drag_xy_per_s * estimated_velocity.y(),
                    b.drag_z_per_s * estimated_velocity.z());
  return fly_force(parameters, body, b.mass_kg * (acceleration + drag + Vector(0, 0, gravity_mps2)), setpoint.yaw_rate);
}

Motors fly_attitude(const Parameters& parameters, const Body& body, const Vector& estimated_velocity,
                    const VelocitySetpoint& setpoint) {
  const ControlParameters& c = parameters.control;
  const BodyParameters& b = parameters.body;
  Vector acceleration = Vector::Zero();
  acceleration.z() = (std::clamp(setpoint.velocity.z(), -c.max_speed_mps, c.max_speed_mps) - estimated_velocity.z()) /
                     c.velocity_lag_s;
  acceleration.z() =
      std::clamp(acceleration.z(), -c.max_vertical_mps2, c.max_vertical_mps2) + b.drag_z_per_s * estimated_velocity.z();
  Eigen::Vector2d stick = setpoint.velocity.head<2>() / parameters.sdk.rc_full_mps;
  if (const double length = stick.norm(); length > 1) stick /= length;
  acceleration.head<2>() = stick * (acceleration.z() + gravity_mps2) * std::tan(c.attitude_full_rad);
  return fly_force(parameters, body, b.mass_kg * (acceleration + Vector(0, 0, gravity_mps2)), setpoint.yaw_rate);
}

Motors fly_rates(const Parameters& parameters, const Body& body, const Vector& rates, double thrust_by_weight) {
  const BodyParameters& b = parameters.body;
  const Vector inertia(b.inertia_xy_kgm2, b.inertia_xy_kgm2, b.inertia_z_kgm2);
  Motors motors;
  motors.thrust_n = thrust_by_weight * b.mass_kg * gravity_mps2;
  motors.torque_nm = inertia.cwiseProduct(rates - body.rates) / rate_loop_s;
  return motors;
}

namespace {

constexpr double rest_mps = 0.15;  // [A] slower than this with centred sticks: hold this position
// [A] What the integral may add: a Tello holds its position in wind up to some 4 m/s. More would only wind up.
constexpr double max_learned_mps = 1.0;

}  // namespace

void PlaceHold::release() {
  release_sideways();
  height_m_.reset();
  learned_up_mps_ = 0;
}

void PlaceHold::release_sideways() {
  position_.reset();
  learned_mps_.setZero();
  centred_s_ = 0;
}

void PlaceHold::hold(const Eigen::Vector2d& position) {
  release_sideways();
  position_ = position;
}

void PlaceHold::shift(const Eigen::Vector2d& by) {
  if (position_) *position_ += by;
}

void PlaceHold::hold_height(double height_m) {
  height_m_ = height_m;
  learned_up_mps_ = 0;
}

Eigen::Vector2d PlaceHold::sideways(const Eigen::Vector2d& wanted, const Vector& position, const Vector& velocity) {
  if (wanted.squaredNorm() > 0) {
    release_sideways();
    return wanted;
  }
  centred_s_ += step_s;
  if (!position_ && (velocity.head<2>().norm() < rest_mps || centred_s_ > p_.hold_after_s))
    position_ = position.head<2>() + velocity.head<2>() * p_.velocity_lag_s;
  if (!position_) return wanted;
  const Eigen::Vector2d error = *position_ - position.head<2>();
  learned_mps_ += p_.hold_integral_per_s2 * error * step_s;
  if (const double length = learned_mps_.norm(); length > max_learned_mps) learned_mps_ *= max_learned_mps / length;
  return p_.position_gain_per_s * error + learned_mps_;
}

double PlaceHold::upward(double wanted_mps, const Vector& position, const Vector& velocity) {
  if (wanted_mps != 0) {
    height_m_.reset();
    learned_up_mps_ = 0;
    return wanted_mps;
  }
  if (!height_m_ && std::abs(velocity.z()) < rest_mps) hold_height(position.z() + velocity.z() * p_.velocity_lag_s);
  if (!height_m_) return wanted_mps;
  const double error = *height_m_ - position.z();
  learned_up_mps_ =
      std::clamp(learned_up_mps_ + p_.hold_integral_per_s2 * error * step_s, -max_learned_mps, max_learned_mps);
  return p_.position_gain_per_s * error + learned_up_mps_;
}

Vector PlaceHold::position() const {
  const Eigen::Vector2d xy = position_.value_or(Eigen::Vector2d::Zero());
  return {xy.x(), xy.y(), height_m_.value_or(0)};
}

}  // namespace ledgerline::sim
