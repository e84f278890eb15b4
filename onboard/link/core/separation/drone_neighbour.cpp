#include <algorithm>
#include <cmath>

#include "onboard/link/core/drone_link.hpp"

/// A drone as the others of its host must take it.
namespace ledgerline::link {
namespace {

// Two standard deviations cover 19 of 20 positions. With three, two drones that fly by onboard odometry would soon
// block each other across a room.
constexpr double blur_sigmas = 2;
// Of a drone that may be anywhere (first seen in the air, without motion capture) nobody can keep away, and who tried
// would never move again.
constexpr double max_sigma_m = 2;
// Down onto what is below: as a Tello lands by itself.
constexpr float landing_mps = 0.5F;

}  // namespace

bool DroneLink::among_others(TimeNs now, Neighbour& out) noexcept {
  verdict_.reset();
  const FlightPhase phase = session_.phase();
  const bool flies = may_fly();
  // Of one in the air an old place is better than none.
  if (!in_common_frame_ || pose_.stamp_ns == 0) return false;
  const double sigma_m = std::sqrt(static_cast<double>(std::max(pose_.variance[0], pose_.variance[1])));
  if (sigma_m > max_sigma_m) return false;
  if (!flies && now - pose_.stamp_ns > failsafe_settings_.pose_lost_ns) return false;
  const Playout::CurrentSetpoint setpoint = desired_setpoint(now);
  const bool flying = phase == FlightPhase::flying;
  const bool steered = flying && (landing_.asked() || follows_plan(failsafe_.mode, setpoint.valid));
  const bool sinks = phase == FlightPhase::landing || failsafe_.mode == FailsafeMode::cut ||
                     (failsafe_.mode == FailsafeMode::land && !landing_.asked());
  using Kind = Neighbour::Kind;
  out = {.number = number_,
         .kind = !flies                             ? Kind::standing
                 : sinks                            ? Kind::sinking
                 : phase == FlightPhase::taking_off ? Kind::rising
                 : steered                          ? Kind::steered
                                                    : Kind::held,
         .motion = {.velocity_mps = pose_.velocity_mps,
                    .late_s = to_seconds(pose_came_ns_ - pose_.stamp_ns),
                    .age_s = to_seconds(now - pose_.stamp_ns)},
         .can_step_aside = flying && failsafe_.mode == FailsafeMode::hold && placed(now),
         .lands = landing_.asked(),
         .floor_m = fence_.min_m[2],
         .ceiling_m = fence_.max_m[2]};
  std::array<double, 3> place_m{};
  for (std::size_t i = 0; i < 3; ++i) place_m[i] = pose_.position_m[i] + moved_m_[i];
  out.motion.position_m = place_m;
  out.motion.blur_m = blur_sigmas * sigma_m;
  if (flying) {
    for (std::size_t i = 0; i < 3; ++i) out.motion.sent_mps[i] = static_cast<double>(limiter_.output().mps[i]);
  }
  if (!steered) return true;
  const Velocity inside = clip_at_fence(drawn_fence_, place_m, session_.state().height_m, in_map(setpoint, now));
  for (std::size_t i = 0; i < 3; ++i) out.desired_mps[i] = static_cast<double>(inside.mps[i]);
  return true;
}

Playout::CurrentSetpoint DroneLink::desired_setpoint(TimeNs now) noexcept {
  if (!landing_.asked()) return playout_.setpoint(now);
  return {.valid = true, .velocity = {{0, 0, -landing_mps}, 0}, .body_frame = by_hand_};
}

bool DroneLink::placed(TimeNs now) const noexcept {
  return now - pose_.stamp_ns <= pose_limit_ns(failsafe_settings_, facts_.by_odometry);
}

bool DroneLink::landing_waits(const LinkMoment& at) const noexcept {
  return verdict_ && verdict_->landing_waits && at.healthy && can_wait_to_land(failsafe_, facts_) && placed(at.now) &&
         landing_.in_time(at.now);
}

bool DroneLink::steps_aside() const noexcept {
  return failsafe_.mode == FailsafeMode::hold && verdict_ && verdict_->kind == Verdict::Kind::part;
}

bool DroneLink::makes_room() const noexcept {
  return session_.phase() == FlightPhase::flying && (landing_.asked() || steps_aside());
}

Velocity DroneLink::left_by_others(Velocity desired) const noexcept {
  if (!verdict_ || verdict_->kind == Verdict::Kind::unchanged) return desired;
  for (std::size_t i = 0; i < 3; ++i) desired.mps[i] = static_cast<float>(verdict_->velocity_mps[i]);
  return desired;
}

bool DroneLink::too_near() const noexcept {
  if (!verdict_) return false;
  return verdict_->kind != Verdict::Kind::unchanged || (landing_.asked() && verdict_->landing_waits) ||
         (!may_fly() && verdict_->takeoff_refused);
}

}  // namespace ledgerline::link
