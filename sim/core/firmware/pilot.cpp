#include "sim/core/firmware/pilot.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ledgerline::sim {
namespace {

// What no parameter describes. Sources as in parameters.hpp; all of these are [A], assumed: nobody published them.
constexpr double move_end_mps = 0.15;  // a move's end: about at rest
constexpr double reached_m = 0.08;     // and so near
constexpr double reached_rad = 0.03;
constexpr double settle_s = 1.0;              // a move ends this long after its profile in any case
constexpr double floor_m = 0.2;               // the Tello does not fly lower unless it lands
constexpr double slow_landing_below_m = 0.3;  // from here on at touchdown_mps
constexpr int touchdown_steps = 50;           // at rest on the ground this long: motors off
constexpr double turn_acceleration_radps2 = 6;
constexpr double turn_gain_per_s = 3;
constexpr double upright_rad = 0.3;
constexpr std::uint64_t takeoff_seed = 0x74616b65;  // of random numbers beside flow's
// On the cushion of its own air a drone may float above the ground: it presses down harder then, by so much a second
// for each m/s that it sinks too slowly, until it touches.
constexpr double floats_below = 0.5, press_per_s = 2, max_press_mps = 1;
// A flip: climb, one turn with thrust only while the propellers point up, then back to where it began.
constexpr double flip_jump_s = 0.25, flip_jump_thrust = 1.8, flip_radps = 20, flip_recover_s = 3.0;

}  // namespace

Pilot::Pilot(const Parameters& parameters, std::uint64_t seed)
    : p_(parameters), odometry_(parameters, seed), takeoffs_(seed ^ takeoff_seed), hold_(parameters.control) {}

bool Pilot::busy() const {
  return phase_ == Phase::spinning_up || phase_ == Phase::climbing || phase_ == Phase::landing ||
         !std::holds_alternative<std::monostate>(action_);
}

std::optional<Pilot::End> Pilot::pop_end() {
  const auto end = end_;
  end_.reset();
  return end;
}

void Pilot::finish(End end) {
  action_ = std::monostate{};
  end_ = end;
}

void Pilot::begin_move() {
  stick_velocity_.setZero();
  stick_yaw_rate_ = 0;
  hold_.release();
  action_s_ = 0;
}

bool Pilot::takeoff(const Body& body) {
  if (phase_ != Phase::off || tilt_of(body.attitude) > upright_rad) return false;
  crashed_ = false;
  idling_ = false;
  odometry_.reset_height();
  takeoff_z_ = body.position.z();
  phase_ = Phase::spinning_up;
  phase_s_ = 0;
  begin_move();
  if (const double drift_m = p_.control.takeoff_drift_m; drift_m > 0) {
    const double to_rad = 2 * std::numbers::pi * takeoffs_.uniform();
    drift_by_climb_ = drift_m / p_.control.takeoff_height_m * Eigen::Vector2d(std::cos(to_rad), std::sin(to_rad));
  }
  return true;
}

bool Pilot::land() {
  if (phase_ != Phase::flying) return false;
  action_ = std::monostate{};
  begin_landing();
  return true;
}

void Pilot::begin_landing() {
  stick_velocity_.setZero();
  stick_yaw_rate_ = 0;
  action_s_ = 0;  // it goes on to hold the position that it holds, and what it has learned of the wind
  phase_ = Phase::landing;
  phase_s_ = 0;
  touching_steps_ = 0;
  pressed_down_mps_ = 0;
}

Vector Pilot::to_map(const Vector& v) const {
  Vector turned = v;
  turned.head<2>() = Eigen::Rotation2Dd(odometry_.yaw_rad()) * v.head<2>();
  return turned;
}

bool Pilot::line(const Vector& offset, double speed_mps) {
  if (!ready_for_move()) return false;
  begin_move();
  const Path path = Path::line(odometry_.position(), to_map(offset));
  action_ = Move{path, SpeedProfile(path.length(), speed_mps, p_.control.move_acceleration_mps2)};
  return true;
}

bool Pilot::arc(const Vector& via, const Vector& end, double speed_mps) {
  const auto path = Path::arc(odometry_.position(), to_map(via), to_map(end));
  if (!path || !ready_for_move()) return false;
  begin_move();
  action_ = Move{*path, SpeedProfile(path->length(), speed_mps, p_.control.move_acceleration_mps2)};
  return true;
}

bool Pilot::turn(double angle_rad, double rate_radps) {
  if (!ready_for_move()) return false;
  begin_move();
  action_ = Turn{odometry_.yaw_rad(), angle_rad < 0 ? -1.0 : 1.0,
                 SpeedProfile(std::abs(angle_rad), rate_radps, turn_acceleration_radps2)};
  return true;
}

bool Pilot::flip(const Vector& axis) {
  if (!ready_for_move()) return false;
  begin_move();
  hold_.hold(odometry_.position().head<2>());
  hold_.hold_height(odometry_.position().z());
  action_ = Flipping{.axis = axis};
  return true;
}

void Pilot::sticks(const Vector& velocity_mps, double yaw_rate_radps) {
  if (!ready_for_move()) return;
  stick_velocity_ = velocity_mps;
  stick_yaw_rate_ = yaw_rate_radps;
}

void Pilot::hover() {
  if (phase_ != Phase::flying) return;
  action_ = std::monostate{};
  begin_move();
}

void Pilot::cut() {
  if (busy()) end_ = End::motors_stopped;
  action_ = std::monostate{};
  phase_ = Phase::off;
  idling_ = false;
}

bool Pilot::idle_motors(bool on) {
  if (phase_ != Phase::off || crashed_) return false;
  idling_ = on;
  return true;
}

double Pilot::above_floor(double upward_mps) const {
  return std::max(upward_mps, -2 * (odometry_.position().z() - takeoff_z_ - floor_m));
}

VelocitySetpoint Pilot::hold(const VelocitySetpoint& wanted) {
  VelocitySetpoint out = wanted;
  if (in_attitude_mode()) {
    hold_.release_sideways();  // there is nothing to hold by
  } else {
    out.velocity.head<2>() = hold_.sideways(wanted.velocity.head<2>(), odometry_.position(), odometry_.velocity());
  }
  out.velocity.z() = above_floor(hold_.upward(wanted.velocity.z(), odometry_.position(), odometry_.velocity()));
  return out;
}

Motors Pilot::steer(const Body& body, const VelocitySetpoint& setpoint) const {
  return in_attitude_mode() ? fly_attitude(p_, body, odometry_.velocity(), setpoint)
                            : fly_velocity(p_, body, odometry_.velocity(), setpoint);
}

VelocitySetpoint Pilot::follow(const Move& move) {
  const auto along = move.profile.at(action_s_);
  const Path::Point point = move.path.at(along.distance);
  const Vector error = point.position - odometry_.position();
  VelocitySetpoint out;
  out.velocity = along.speed * point.tangent + p_.control.position_gain_per_s * error;
  out.acceleration = along.acceleration * point.tangent + along.speed * along.speed * point.normal_curvature;
  const double over = action_s_ - move.profile.duration_s();
  if (over > settle_s || (over > 0 && error.norm() < reached_m && odometry_.velocity().norm() < move_end_mps)) {
    if (error.norm() < 2 * reached_m) {
      hold_.hold(point.position.head<2>());
      hold_.hold_height(point.position.z());
    }
    finish(End::reached);
  }
  return out;
}

VelocitySetpoint Pilot::rotate(const Turn& turn) {
  const auto along = turn.profile.at(action_s_);
  const double error = turn.from + turn.sign * along.distance - odometry_.yaw_rad();
  VelocitySetpoint out;
  out.yaw_rate = turn.sign * (along.speed + along.acceleration * p_.control.yaw_rate_lag_s) + turn_gain_per_s * error;
  const double over = action_s_ - turn.profile.duration_s();
  if (over > settle_s || (over > 0 && std::abs(error) < reached_rad)) finish(End::reached);
  return out;
}

VelocitySetpoint Pilot::climb() {
  const double left_m = takeoff_z_ + p_.control.takeoff_height_m - odometry_.position().z();
  hold_.shift(drift_by_climb_ * odometry_.velocity().z() * step_s);
  VelocitySetpoint wanted = hold({});
  wanted.velocity.z() = std::min(p_.control.takeoff_mps, p_.control.position_gain_per_s * left_m);
  if (std::abs(left_m) < 0.05 && std::abs(odometry_.velocity().z()) < 0.1) {
    phase_ = Phase::flying;
    hold_.hold_height(takeoff_z_ + p_.control.takeoff_height_m);
    finish(End::reached);
  }
  return wanted;
}

VelocitySetpoint Pilot::descend() {
  VelocitySetpoint wanted = hold({});
  wanted.velocity.z() = -p_.control.landing_mps;
  if (odometry_.position().z() < slow_landing_below_m) {
    const double too_slow_mps = odometry_.velocity().z() + p_.control.touchdown_mps;
    if (too_slow_mps > floats_below * p_.control.touchdown_mps)
      pressed_down_mps_ = std::min(max_press_mps, pressed_down_mps_ + press_per_s * too_slow_mps * step_s);
    wanted.velocity.z() = -p_.control.touchdown_mps - pressed_down_mps_;
  }
  return wanted;
}

VelocitySetpoint Pilot::fly() {
  action_s_ += step_s;
  if (const auto* move = std::get_if<Move>(&action_)) {
    VelocitySetpoint out = follow(*move);
    out.velocity.z() = above_floor(out.velocity.z());
    return out;
  }
  VelocitySetpoint wanted;
  if (const auto* turn = std::get_if<Turn>(&action_)) {
    wanted = rotate(*turn);
  } else {
    wanted.velocity = to_map(stick_velocity_);
    wanted.yaw_rate = stick_yaw_rate_;
  }
  return hold(wanted);
}

Motors Pilot::somersault(Flipping& flip, const Body& body) {
  action_s_ += step_s;
  using Stage = Flipping::Stage;
  if (flip.stage == Stage::jump) {
    if (action_s_ < flip_jump_s) return fly_rates(p_, body, Vector::Zero(), flip_jump_thrust);
    flip.stage = Stage::spin;
  }
  if (flip.stage == Stage::spin) {
    flip.angle += body.rates.dot(flip.axis) * step_s;
    // Slow down over the last part, so that the attitude loop takes over smoothly.
    const double left = 2 * std::numbers::pi - flip.angle;
    if (left > 0.1)
      return fly_rates(p_, body, flip.axis * std::min(flip_radps, 4 + 10 * left), std::cos(flip.angle) > 0 ? 1.5 : 0.1);
    flip.stage = Stage::recover;
    action_s_ = 0;
  }
  const Vector off = hold_.position() - odometry_.position();
  const bool back = std::abs(off.z()) < reached_m && off.head<2>().norm() < 2 * reached_m;
  if (action_s_ > flip_recover_s || (back && odometry_.velocity().norm() < move_end_mps)) finish(End::reached);
  return steer(body, hold({}));
}

Motors Pilot::step(const Body& body, const Sensing& sensing) {
  odometry_.step(body, sensing);
  if (motors_on()) motor_s_ += step_s;
  phase_s_ += step_s;
  const double weight = p_.body.mass_kg * gravity_mps2;
  const auto* flip = std::get_if<Flipping>(&action_);
  const bool spinning = flip && flip->stage != Flipping::Stage::recover;
  if (phase_ != Phase::off && !spinning && tilt_of(body.attitude) > p_.control.crash_tilt_rad) {
    cut();
    crashed_ = true;
  }

  switch (phase_) {
    case Phase::off: {
      Motors motors;
      motors.thrust_n = idling_ ? 0.05 * weight : 0;
      return motors;
    }
    case Phase::spinning_up: {
      if (phase_s_ >= p_.control.spin_up_s) phase_ = Phase::climbing;
      Motors motors;
      motors.thrust_n = 0.5 * weight * std::min(1.0, phase_s_ / p_.control.spin_up_s);
      return motors;
    }
    case Phase::climbing: {
      if (phase_s_ > p_.control.takeoff_limit_s) {
        finish(End::broken_off);
        begin_landing();
        return steer(body, hold({}));
      }
      return steer(body, climb());
    }
    case Phase::landing: {
      touching_steps_ = body.touching ? touching_steps_ + 1 : 0;
      if (touching_steps_ >= touchdown_steps) {
        phase_ = Phase::off;
        finish(End::reached);
        return {};
      }
      return steer(body, descend());
    }
    case Phase::flying:
      break;
  }
  if (auto* somersaulting = std::get_if<Flipping>(&action_)) return somersault(*somersaulting, body);
  return steer(body, fly());
}

}  // namespace ledgerline::sim
