#include "onboard/link/core/playout/setpoint_path.hpp"

#include <algorithm>
#include <cmath>

#include "common/base/check.hpp"
#include "onboard/link/core/failsafe.hpp"

namespace ledgerline::link {
namespace {

// Down onto what is below: as a Tello lands by itself.
constexpr float landing_mps = 0.5F;

}  // namespace

void Limiter::reset(TimeNs now) noexcept {
  output_ = {};
  last_ns_ = now;
}

const Velocity& Limiter::step(TimeNs now, const Velocity& desired, bool braking) noexcept {
  // A long gap between two steps must not allow one big jump.
  const auto dt = static_cast<float>(std::clamp(to_seconds(now - last_ns_), 0.0, 0.05));
  last_ns_ = now;

  std::array<float, 3> goal = desired.mps;
  const float speed = std::hypot(goal[0], goal[1]);
  if (speed > settings_.max_speed_mps) {
    goal[0] *= settings_.max_speed_mps / speed;
    goal[1] *= settings_.max_speed_mps / speed;
  }
  goal[2] = std::clamp(goal[2], -settings_.max_vertical_mps, settings_.max_vertical_mps);

  std::array<float, 3> change{};
  for (std::size_t i = 0; i < 3; ++i) change[i] = goal[i] - output_.mps[i];
  const float wanted = std::hypot(change[0], change[1], change[2]);
  const float allowed = settings_.max_acceleration_mps2 * (braking ? 2.0F : 1.0F) * dt;
  if (wanted <= allowed) {
    output_.mps = goal;  // exactly: zero is reached, not approached
  } else {
    for (std::size_t i = 0; i < 3; ++i) output_.mps[i] += change[i] * allowed / wanted;
  }

  const float yaw = std::clamp(desired.yaw_radps, -settings_.max_yaw_rate_radps, settings_.max_yaw_rate_radps);
  const float yaw_change = settings_.max_yaw_acceleration_radps2 * dt;
  output_.yaw_radps += std::clamp(yaw - output_.yaw_radps, -yaw_change, yaw_change);
  return output_;
}

bool Limiter::is_within_limits() const noexcept {
  constexpr float rounding = 1.001F;
  return std::hypot(output_.mps[0], output_.mps[1]) <= rounding * settings_.max_speed_mps &&
         std::abs(output_.mps[2]) <= rounding * settings_.max_vertical_mps &&
         std::abs(output_.yaw_radps) <= rounding * settings_.max_yaw_rate_radps;
}

Playout::CurrentSetpoint SetpointPath::desired(TimeNs now, bool landing_requested) noexcept {
  if (!landing_requested) return playout_.setpoint(now);
  return {.valid = true, .velocity = {{0, 0, -landing_mps}, 0}, .body_frame = by_hand_};
}

Velocity SetpointPath::apply_clearance(Velocity desired) const noexcept {
  if (!clearance_ || clearance_->kind == Clearance::Kind::unchanged) return desired;
  for (std::size_t i = 0; i < 3; ++i) desired.mps[i] = static_cast<float>(clearance_->velocity_mps[i]);
  return desired;
}

void SetpointPath::on_phase(TimeNs now, LinkPhase phase) noexcept {
  if (phase == LinkPhase::flying) {
    limiter_.reset(now);
    return;
  }
  playout_.clear(DropReason::not_flying);
  sent_ = {};
  last_rc_ = {};
}

bool SetpointPath::fly(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint,
                       const Steering& steering) noexcept {
  drawn_fence_ = steering.fence;
  const bool yields = steering.follows || steering.steps_aside;
  const Velocity apart = yields ? apply_clearance(steering.velocity) : steering.velocity;
  const Velocity goal = clip_at_fence(drawn_fence_, steering.position_m, steering.height_m, apart, steering.push_mps);
  const Velocity& limited = limiter_.step(at.now, goal, steering.brakes);
  if (!LEDGERLINE_CHECK(limiter_.is_within_limits(), "what is sent is a number, and within the limits", drone_,
                        limited.mps[0], limited.mps[1], limited.mps[2], limited.yaw_radps))
    limiter_.reset(at.now);
  const BodyCommand command = to_body(rc_settings_, limited, steering.yaw_rad);

  const TimeNs gap = steering.follows && setpoint.fresh ? rc_settings_.min_gap_ns
                     : command.rc != last_rc_           ? rc_settings_.changing_gap_ns
                                                        : rc_settings_.max_gap_ns;
  if (at.now - last_rc_ns_ < gap) return false;
  send(at, command.sent, command.rc);
  return true;
}

void SetpointPath::fall_silent(const LinkMoment& at) noexcept {
  playout_.clear(DropReason::not_flying);
  limiter_.reset(at.now);
  if (last_rc_ != Rc{}) send_zero(at);
}

void SetpointPath::send(const LinkMoment& at, const Velocity& sent, const Rc& rc) noexcept {
  LEDGERLINE_CHECK(std::ranges::all_of(rc, [](int channel) { return std::abs(channel) <= 100; }), "rc keeps its range",
                   drone_, rc[0], rc[1], rc[2], rc[3]);
  at.out.to_send.push({drone_, rc_text(rc)});
  at.out.trace.push({.t_ns = at.now,
                     .kind = TraceKind::rc_sent,
                     .drone = drone_,
                     .v = {double(rc[0]), double(rc[1]), double(rc[2]), double(rc[3])}});
  last_rc_ns_ = at.now;
  last_rc_ = rc;
  sent_ = sent;
}

}  // namespace ledgerline::link
