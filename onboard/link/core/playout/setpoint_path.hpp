#pragma once
#include <array>
#include <optional>

#include "onboard/link/core/link_io.hpp"
#include "onboard/link/core/playout/playout.hpp"
#include "onboard/link/core/separation.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// Keeps a velocity within speed and acceleration limits. Core: no allocation; one thread.
class Limiter {
 public:
  explicit Limiter(const PlayoutSettings& settings) noexcept : settings_(settings) {}
  /// `braking` doubles the acceleration allowed: for failsafe brakes only.
  const Velocity& step(TimeNs now, const Velocity& desired, bool braking) noexcept;
  const Velocity& output() const noexcept { return output_; }
  /// False of what is no number, too.
  bool is_within_limits() const noexcept;
  /// The drone is known to stand still (on the ground, or right after take-off).
  void reset(TimeNs now) noexcept;

 private:
  PlayoutSettings settings_;
  Velocity output_;
  TimeNs last_ns_ = 0;
};

/// How a setpoint is to be flown in a step, as failsafe and position say.
struct Steering {
  bool follows = false;      ///< the setpoint is flown, kept apart from other drones
  bool steps_aside = false;  ///< else what the clearance says is
  bool brakes = false;       ///< with twice the deceleration
  Velocity velocity{};       ///< in the map, before the other drones and the last clip at the fence
  float push_mps = 0;        ///< from beyond the fence, back inside
  double yaw_rad = 0;        ///< of the drone, in the map
  FenceSettings fence{};     ///< as it holds now
  std::array<double, 3> position_m{};
  float height_m = 0;
};

/// A drone's setpoints from its admitted plans to what it is sent: playout, the other drones, fence, limits, rc. Does
/// not move; `admission` outlives it. Core: no I/O, no clock, no allocation; one thread.
class SetpointPath {
 public:
  SetpointPath(DroneNumber drone, const LinkSettings& settings, PlanAdmission& admission) noexcept
      : drone_(drone),
        rc_settings_(settings.rc),
        playout_(settings.playout, admission),
        limiter_(settings.playout),
        drawn_fence_(settings.fence) {}

  void add(TimeNs now, const Plan& plan) noexcept { playout_.add(now, plan); }
  void drop_plans(DropReason reason) noexcept { playout_.clear(reason); }
  TimeNs margin_ns() const noexcept { return playout_.margin_ns(); }
  TimeNs covered_until_ns() const noexcept { return playout_.covered_until_ns(); }

  /// The newest plan that was to be flown is in the drone's frame.
  void set_by_hand(bool by_hand) noexcept { by_hand_ = by_hand; }
  bool is_by_hand() const noexcept { return by_hand_; }
  /// Of its plans; while a landing waits: downward.
  Playout::CurrentSetpoint desired(TimeNs now, bool landing_requested) noexcept;

  /// What of it may be flown, as separation says in this step; none: it is alone.
  void set_clearance(const std::optional<Clearance>& clearance) noexcept { clearance_ = clearance; }
  const std::optional<Clearance>& clearance() const noexcept { return clearance_; }
  /// Another wants it out of the way.
  bool should_step_aside() const noexcept { return clearance_ && clearance_->kind == Clearance::Kind::give_way; }

  void on_phase(TimeNs now, LinkPhase phase) noexcept;
  /// In every step that flies. True when it was sent something; then the caller may mark_applied().
  bool fly(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint, const Steering& steering) noexcept;
  /// Link is not healthy: one zero, since a drone goes on with its last rc; then silence (health_rest_ns).
  void fall_silent(const LinkMoment& at) noexcept;
  void send_zero(const LinkMoment& at) noexcept { send(at, {}, {}); }
  /// True when it was its plan's first.
  bool mark_applied() noexcept { return playout_.mark_sent(); }

  /// As sent to the drone, after limits, failsafe and rc's range.
  const Velocity& sent() const noexcept { return sent_; }
  /// The same before rc's range.
  const Velocity& limited() const noexcept { return limiter_.output(); }
  /// As it held in the last step that flew.
  const FenceSettings& drawn_fence() const noexcept { return drawn_fence_; }

 private:
  Velocity apply_clearance(Velocity desired) const noexcept;
  void send(const LinkMoment& at, const Velocity& sent, const Rc& rc) noexcept;

  DroneNumber drone_;
  RcSettings rc_settings_;
  Playout playout_;
  Limiter limiter_;
  bool by_hand_ = false;
  std::optional<Clearance> clearance_;
  FenceSettings drawn_fence_;
  TimeNs last_rc_ns_ = 0;
  Rc last_rc_{};
  Velocity sent_;
};

}  // namespace ledgerline::link
