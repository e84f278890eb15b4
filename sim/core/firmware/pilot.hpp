#pragma once
#include <optional>
#include <variant>

#include "sim/core/firmware/controller.hpp"
#include "sim/core/firmware/odometry.hpp"
#include "sim/core/path.hpp"

namespace ledgerline::sim {

/// The Tello's own flight logic: phases, sticks, moves, hovering, flips.
///
///            takeoff()                   height reached
///     off ------------> spinning_up --> climbing ------> flying <--> (a move, turn or flip)
///      ^ touched down, cut(), turned over                   | land()
///      +------------------------------------ landing <------+
///
/// One action (takeoff, landing, move) runs at a time; pop_end() says once how it ended. Moves are measured with the
/// drone's own odometry, which drifts as its velocity estimate does. Where flow stays lost it is in attitude mode: the
/// sticks command a lean, and drag alone slows it. One thread.
class Pilot {
 public:
  enum class Phase { off, spinning_up, climbing, flying, landing };
  enum class End { reached, broken_off, motors_stopped };

  Pilot(const Parameters& parameters, std::uint64_t seed);

  /// Every millisecond of flight: what the motors do now.
  Motors step(const Body& body, const Sensing& sensing);

  // Requests: false where the phase does not allow it; nothing changes then.
  bool takeoff(const Body& body);
  /// Breaks off a move; refused while taking off, landing or on the ground.
  bool land();
  bool line(const Vector& offset, double speed_mps);
  bool arc(const Vector& via, const Vector& end, double speed_mps);  ///< the points must not lie on one line
  bool turn(double angle_rad, double rate_radps);
  bool flip(const Vector& axis);  ///< once around it, in body axes
  /// Sticks hold until they are set again; ignored unless flying without a move. Velocity: forward, left, up.
  void sticks(const Vector& velocity_mps, double yaw_rate_radps);
  /// Breaks off a move and holds the place; zeroes the sticks.
  void hover();
  void cut();
  /// Spins the motors on the ground (to cool them).
  bool idle_motors(bool on);

  Phase phase() const { return phase_; }
  bool busy() const;
  bool crashed() const { return crashed_; }
  bool motors_on() const { return phase_ != Phase::off || idling_; }
  double takeoff_z() const { return takeoff_z_; }
  double motor_seconds() const { return motor_s_; }
  const Flow& flow() const { return odometry_.flow(); }
  /// How the last action ended; once.
  std::optional<End> pop_end();

 private:
  struct Move {
    Path path;
    SpeedProfile profile;
  };
  struct Turn {
    double from = 0, sign = 1;
    SpeedProfile profile;
  };
  struct Flipping {
    Vector axis = Vector::Zero();
    double angle = 0;
    enum class Stage { jump, spin, recover } stage = Stage::jump;
  };

  void finish(End end);
  bool ready_for_move() const { return phase_ == Phase::flying && !busy(); }
  void begin_move();
  void begin_landing();
  Vector to_map(const Vector& heading_frame) const;
  VelocitySetpoint hold(const VelocitySetpoint& wanted);
  double above_floor(double upward_mps) const;
  VelocitySetpoint climb();
  VelocitySetpoint descend();
  bool in_attitude_mode() const { return odometry_.flow_lost_s() > p_.control.attitude_after_s; }
  Motors steer(const Body& body, const VelocitySetpoint& setpoint) const;
  VelocitySetpoint fly();
  VelocitySetpoint follow(const Move& move);
  VelocitySetpoint rotate(const Turn& turn);
  Motors somersault(Flipping& flip, const Body& body);

  Parameters p_;
  Odometry odometry_;
  Random takeoffs_;
  Phase phase_ = Phase::off;
  bool crashed_ = false, idling_ = false;
  double phase_s_ = 0, motor_s_ = 0, takeoff_z_ = 0;
  int touching_steps_ = 0;

  std::variant<std::monostate, Move, Turn, Flipping> action_;
  double action_s_ = 0;
  Vector stick_velocity_ = Vector::Zero();
  double stick_yaw_rate_ = 0;
  PlaceHold hold_;
  Eigen::Vector2d drift_by_climb_ = Eigen::Vector2d::Zero();  ///< how far sideways for each metre that it rises
  double pressed_down_mps_ = 0;                               ///< what a landing adds while it floats above the ground
  std::optional<End> end_;
};

}  // namespace ledgerline::sim
