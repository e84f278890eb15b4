#include "onboard/link/core/drone_link.hpp"

#include <algorithm>
#include <cmath>

#include "common/base/check.hpp"
#include "common/msg/names.hpp"

namespace ledgerline::link {
namespace {

// 19 of 20 positions. With three, two drones that fly by onboard odometry soon block each other across a room.
constexpr double blur_sigmas = 2;
// A drone this uncertain cannot be avoided; trying would block the others for ever.
constexpr double max_sigma_m = 2;
// For so long the page shows that the drone refused a take-off. Half is missed by who looks away; with double it stands
// there still when the drone was put right.
constexpr TimeNs takeoff_refusal_shown_ns = 10 * ns_per_s;

/// Where a path leads beyond the fence, its drone waits there.
Reference inside(const FenceSettings& fence, Reference reference) noexcept {
  for (std::size_t i = 0; i < 3; ++i) {
    const auto low = static_cast<float>(fence.min_m[i]), high = std::max(low, static_cast<float>(fence.max_m[i]));
    float& at = reference.position_m[i];
    if (at >= low && at <= high) continue;
    at = std::clamp(at, low, high);
    reference.velocity_mps[i] = reference.acceleration_mps2[i] = 0;
  }
  return reference;
}

}  // namespace

DroneLink::DroneLink(const DroneSettings& drone, const LinkSettings& settings, std::uint64_t boot_id, bool local_stop)
    : number_(drone.number),
      failsafe_settings_(settings.failsafe),
      fence_(settings.fence),
      track_settings_(settings.track),
      by_hand_without_pose_(drone.by_hand_without_pose),
      in_common_frame_(drone.in_common_frame),
      session_(settings.session, drone.serial, drone.source == PoseSource::pads),
      position_(drone, settings.pads, settings.failsafe.pose_lost_ns),
      orders_(session_, from_seconds(settings.separation.landing_wait_s), local_stop),
      admission_(settings.playout),
      setpoints_(drone.number, settings, admission_),
      tracker_(settings.track),
      reporting_(drone.name, drone.number, boot_id) {}

void DroneLink::on_bytes(TimeNs now, Port port, std::string_view bytes) noexcept {
  if (port == Port::answer) {
    session_.on_answer(now, bytes);
    watches_.client.on_answer(now);
  } else if (session_.on_state(now, bytes)) {
    watches_.on_state(now, session_.state(), session_.phase());
    position_.on_state(now, session_.state(), session_.phase(), session_.is_standing(now), setpoints_.sent());
    tracker_.on_pose(position_.published_pose());
  }
}

void DroneLink::on_heartbeat(const AgentHeartbeat& heartbeat) noexcept {
  inputs_.heartbeat_ns = heartbeat.stamp_ns;
  inputs_.ledger_alive = heartbeat.ledger_alive;
  inputs_.ledger_untrusted = heartbeat.ledger_untrusted;
  reporting_.on_heartbeat(heartbeat);
}

void DroneLink::on_pose(TimeNs now, const Pose& pose) noexcept {
  position_.on_pose(now, pose, is_in_flight(session_.phase()));
  tracker_.on_pose(position_.published_pose());
}

void DroneLink::grow_older(TimeNs now, TimeNs slept_ns) noexcept {
  setpoints_.drop_plans(DropReason::too_old);
  position_.grow_older(slept_ns);
  tracker_.reset();
  session_.grow_older(slept_ns);
  orders_.refuse_older_takeoffs(now);
}

void DroneLink::on_plan(const LinkMoment& at, const Plan& plan) noexcept {
  reporting_.record_received(at, plan, setpoints_.margin_ns());
  if (admission_.admit(at.now, plan) != DropReason::none) return;
  if (is_empty_plan(plan)) {
    setpoints_.drop_plans(DropReason::superseded);
    admission_.record_applied();
    return;
  }
  if (!is_contract_action(plan.action)) reporting_.record_arrival(at.now, plan);
  const bool flies = plan.action == PlanAction::fly;
  // One that a brake drops counts all the same: by hand it may end.
  if (flies && session_.phase() == LinkPhase::flying) setpoints_.set_by_hand(plan.body_frame);
  const DropReason reason = flies ? may_follow(at, plan) : obey(at, plan);
  if (reason != DropReason::none) {
    admission_.record_end(plan, reason);
  } else if (flies) {
    setpoints_.add(at.now, plan);
  } else {
    admission_.record_applied();
    // Clearing a stop is not recorded as flown.
    if (plan.action < PlanAction::stop_cleared) reporting_.record_applied(at, plan, setpoints_.sent());
  }
}

DropReason DroneLink::may_follow(const LinkMoment& at, const Plan& plan) const noexcept {
  if (plan.state_stamp_ns < at.not_before_ns) return DropReason::too_old;
  const bool follows = failsafe_.mode == FailsafeMode::none || failsafe_.mode == FailsafeMode::hold;
  const bool flying = session_.phase() == LinkPhase::flying && !orders_.is_landing_requested();
  return flying && follows && at.healthy ? DropReason::none : DropReason::not_flying;
}

DropReason DroneLink::obey(const LinkMoment& at, const Plan& plan) noexcept {
  switch (plan.action) {
    case PlanAction::takeoff:
      return take_off(at, plan);
    case PlanAction::land: {
      const DropReason reason = orders_.land(at.now);
      if (reason == DropReason::none) setpoints_.drop_plans(DropReason::superseded);
      return reason;
    }
    case PlanAction::stop:
    case PlanAction::cut:
      orders_.stop(at.now, plan);
      setpoints_.drop_plans(DropReason::superseded);
      return DropReason::none;
    case PlanAction::stop_cleared:
    case PlanAction::stop_cleared_by_owner:
      return orders_.clear_stop(plan);
    default:
      return DropReason::bad_value;
  }
}

DropReason DroneLink::take_off(const LinkMoment& at, const Plan& plan) noexcept {
  const LinkPhase phase = session_.phase();
  const bool is_up = phase == LinkPhase::taking_off || phase == LinkPhase::flying;
  if (is_up && !orders_.is_landing_requested()) return DropReason::none;
  if (const DropReason reason = orders_.takeoff_refusal(plan); reason != DropReason::none) return reason;
  update_inputs(at, {});
  inputs_.needs_position = !(plan.body_frame && by_hand_without_pose_);
  const bool refused = takeoff_refusal(failsafe_settings_, fence_, at.now, inputs_) != FailsafeCause::none;
  if (refused || !session_.request_takeoff(at.now)) return DropReason::not_flying;
  setpoints_.set_by_hand(plan.body_frame);
  return DropReason::none;
}

void DroneLink::update_inputs(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint) noexcept {
  const Pose& pose = position_.pose();
  inputs_.phase = session_.phase();
  inputs_.may_be_airborne = session_.may_be_airborne();
  inputs_.flying_since_ns = session_.phase_since_ns();
  inputs_.plan_valid = setpoint.valid;
  inputs_.covered_until_ns = setpoints_.covered_until_ns();
  inputs_.state_ns = session_.state_at_ns();
  inputs_.battery = session_.state().battery;

  inputs_.pose_ns = pose.stamp_ns;
  inputs_.position_m = position_.position_m();
  inputs_.velocity_mps = pose.velocity_mps;
  inputs_.height_m = session_.state().height_m;
  for (std::size_t i = 0; i < 3; ++i) inputs_.sigma_m[i] = std::sqrt(static_cast<double>(pose.variance[i]));
  inputs_.sigma_yaw_rad = std::sqrt(static_cast<double>(pose.variance[3]));
  const bool by_hand = setpoint.valid ? setpoint.body_frame : setpoints_.is_by_hand();
  inputs_.needs_position = !(by_hand && by_hand_without_pose_);
  const bool placed =
      pose.stamp_ns != 0 && (inputs_.needs_position || at.now - pose.stamp_ns < failsafe_settings_.state_stale_ns);
  if (!placed) place_by_height();

  inputs_.by_odometry = position_.is_by_odometry();
  inputs_.fix_overdue = position_.is_fix_overdue();
  inputs_.sources_differ = position_.has_source_conflict();
  inputs_.sources_unresolved = position_.are_sources_unresolved();
  inputs_.motion_differs = position_.does_motion_differ();
  inputs_.dark_since_ns = position_.dark_since_ns(at.now);
  inputs_.height_lost = session_.state().tof_m >= tof_sees_m;
  inputs_.other_client = watches_.client.is_contested(at.now);
  const TimeNs refused_ns = session_.takeoff_refusal().at_ns;
  inputs_.takeoff_refused_by_drone = refused_ns != 0 && at.now - refused_ns < takeoff_refusal_shown_ns;
  inputs_.tilted = watches_.tilt.is_tilted();
  inputs_.overturned = watches_.tilt.is_overturned();
  inputs_.tilt_rad = watches_.tilt.tilt_rad();
  inputs_.landing_battery = watches_.battery.needed(inputs_.height_m);
  inputs_.too_near = is_too_near();
  inputs_.check_failed = at.check_failed;
  inputs_.stop = orders_.is_stopped() || at.stop_all;
  inputs_.cut = orders_.is_cut();
}

void DroneLink::place_by_height() noexcept {
  const TelloState& state = session_.state();
  // A barometer may sink, and h with it; what tof sees below is at least so far away.
  const auto attitude = attitude_rad(state);
  const float below_m = state.tof_m * std::cos(attitude[0]) * std::cos(attitude[1]);
  if (state.tof_m < tof_sees_m) inputs_.height_m = std::max(inputs_.height_m, below_m);
  inputs_.position_m[2] = static_cast<double>(inputs_.height_m);
}

void DroneLink::step(const LinkMoment& at) noexcept {
  const TimeNs now = at.now;
  watch_phase(at);
  orders_.forget_cleared_stops();
  Playout::CurrentSetpoint setpoint = setpoints_.desired(now, orders_.is_landing_requested());
  update_inputs(at, setpoint);
  inputs_.contact_lost = session_.has_lost_contact(now);
  const FailsafeMode before = failsafe_.mode;
  failsafe_ = update(failsafe_settings_, fence_, failsafe_, now, inputs_);
  LEDGERLINE_CHECK(before < FailsafeMode::land || failsafe_.mode >= before || inputs_.overturned ||
                       !session_.is_possibly_in_flight(),
                   "no landing is taken back in the air", number_, name(before), name(failsafe_.mode));
  LEDGERLINE_CHECK(!inputs_.stop || !is_in_flight(inputs_.phase) || failsafe_.mode >= FailsafeMode::land,
                   "one that is stopped lands", number_, name(failsafe_.mode));
  obey_failsafe(now);
  if (orders_.is_landing_requested() && !should_delay_landing(at)) session_.request_land(now);
  if (orders_.is_landing_requested()) setpoint = setpoints_.desired(now, true);
  tracker_.on_sent(now, setpoints_.sent(), !position_.is_motion_suspected());
  if (session_.phase() == LinkPhase::flying) fly(at, setpoint);
  send_commands(at);
  watch_phase(at);
  reporting_.record_transition(at, session_.phase(), failsafe_);
  reporting_.record_ends(at, admission_);
  reporting_.record_serial(at, session_.serial());
  reporting_.record_words(at, session_);
}

void DroneLink::obey_failsafe(TimeNs now) noexcept {
  switch (failsafe_.mode) {
    case FailsafeMode::land:
      orders_.request_landing(now);
      break;
    case FailsafeMode::cut:
      session_.request_cut(now);
      break;
    case FailsafeMode::brake:
      setpoints_.drop_plans(DropReason::not_flying);
      break;
    case FailsafeMode::none:
    case FailsafeMode::hold:
      break;
  }
}

void DroneLink::send_commands(const LinkMoment& at) noexcept {
  for (CommandText text; session_.next_send(at.now, text);) {
    if (text.view() == rc_text({}).view()) {
      setpoints_.send_zero(at);  // the one that a drone without state gets, for the trace
    } else if (LEDGERLINE_CHECK(text.view() != "takeoff" || !inputs_.stop, "one that is stopped is sent no take-off",
                                number_)) {
      at.out.to_send.push({number_, text});
      if (text.view() == "command") watches_.client.on_command(at.now);
    }
  }
}

void DroneLink::fly(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint) noexcept {
  if (!at.healthy) {
    tracker_.let_go();
    setpoints_.fall_silent(at);
    return;
  }
  // A drone that had to land and did not wait is not flying any more.
  const bool lands = orders_.is_landing_requested();
  const bool follows = lands || follows_plan(failsafe_.mode, setpoint.valid);
  const Steering steering{.follows = follows,
                          .steps_aside = steps_aside(),
                          .brakes = failsafe_.mode == FailsafeMode::brake,
                          .velocity = velocity_for(at.now, setpoint, follows),
                          .push_mps = push_mps(at.now),
                          .yaw_rad = position_.yaw_rad(at.now),
                          .fence = fence_for(failsafe_settings_, fence_, failsafe_, at.now, inputs_),
                          .position_m = inputs_.position_m,
                          .height_m = inputs_.height_m};
  if (!setpoints_.fly(at, setpoint, steering) || !steering.follows || lands) return;
  const bool first = setpoints_.mark_applied();
  reporting_.record_setpoint(at, setpoint, first, setpoints_.sent());
}

bool DroneLink::may_track(TimeNs now) const noexcept {
  const bool mode = failsafe_.mode == FailsafeMode::none || failsafe_.mode == FailsafeMode::hold ||
                    (failsafe_.mode == FailsafeMode::brake && failsafe_.cause == FailsafeCause::state_stale);
  // By hand without a position the failsafe minds none of these; no place is held by such a pose.
  const bool contradicted = inputs_.sources_differ || inputs_.sources_unresolved || inputs_.fix_overdue ||
                            inputs_.height_lost || inputs_.dark_since_ns != 0;
  return track_settings_.on_board && mode && !contradicted && session_.phase() == LinkPhase::flying &&
         !orders_.is_landing_requested() && is_freshly_placed(now) && tracker_.may_correct(now);
}

float DroneLink::push_mps(TimeNs now) const noexcept {
  return may_track(now) ? static_cast<float>(track_settings_.max_correction_mps) : 0;
}

Velocity DroneLink::velocity_for(TimeNs now, const Playout::CurrentSetpoint& setpoint, bool follows) noexcept {
  Velocity planned;
  if (follows) planned = setpoint.body_frame ? to_map(setpoint.velocity, position_.yaw_rad(now)) : setpoint.velocity;
  const bool stays = !follows || (!setpoint.has_reference && planned.mps == std::array<float, 3>{});
  // In another's way it stays where separation counts on it.
  const bool in_the_way = stays && is_too_near();
  if (!may_track(now) || steps_aside() || in_the_way || (!stays && !setpoint.has_reference)) {
    tracker_.let_go();
    return planned;
  }
  if (stays) {
    const Velocity held = tracker_.hold(now);
    planned.mps = held.mps;
    return planned;
  }
  const FenceSettings& fence = setpoints_.drawn_fence();
  tracker_.set_response(setpoint.response);
  return tracker_.follow(now, clip_at_fence(fence, position_.position_m(), session_.state().height_m, planned, 0),
                         inside(fence, setpoint.reference));
}

void DroneLink::watch_phase(const LinkMoment& at) noexcept {
  const LinkPhase phase = session_.phase();
  if (phase != last_phase_) {
    orders_.on_phase(at.now, last_phase_, phase);
    position_.on_phase(phase);
    setpoints_.on_phase(at.now, phase);
    tracker_.let_go();
    // It may hover a hand above the ground, and goes on with the last rc of a link that is gone.
    if (last_phase_ == LinkPhase::disconnected && phase == LinkPhase::on_ground) setpoints_.send_zero(at);
    last_phase_ = phase;
  }
  reporting_.record_mode(at, phase, failsafe_);
}

bool DroneLink::is_placed(TimeNs now) const noexcept {
  return now - position_.pose().stamp_ns <= pose_limit_ns(failsafe_settings_, inputs_.by_odometry);
}

bool DroneLink::is_freshly_placed(TimeNs now) const noexcept {
  return now - position_.pose().stamp_ns <= pose_limit_ns(failsafe_settings_, inputs_.by_odometry) / 2;
}

bool DroneLink::should_delay_landing(const LinkMoment& at) const noexcept {
  const auto& clearance = setpoints_.clearance();
  return clearance && clearance->landing_blocked && at.healthy && can_wait_to_land(failsafe_, inputs_) &&
         is_placed(at.now) && orders_.may_wait_longer(at.now);
}

bool DroneLink::makes_room() const noexcept {
  return session_.phase() == LinkPhase::flying && (orders_.is_landing_requested() || steps_aside());
}

bool DroneLink::is_too_near() const noexcept {
  const auto& clearance = setpoints_.clearance();
  if (!clearance) return false;
  return clearance->kind != Clearance::Kind::unchanged ||
         (orders_.is_landing_requested() && clearance->landing_blocked) ||
         (!session_.is_possibly_in_flight() && clearance->takeoff_refused);
}

Neighbour::Kind DroneLink::kind_as_neighbour(bool is_steered) const noexcept {
  const bool sinks = session_.phase() == LinkPhase::landing || failsafe_.mode == FailsafeMode::cut ||
                     (failsafe_.mode == FailsafeMode::land && !orders_.is_landing_requested());
  if (!session_.is_possibly_in_flight()) return Neighbour::Kind::standing;
  if (sinks) return Neighbour::Kind::sinking;
  if (session_.phase() == LinkPhase::taking_off) return Neighbour::Kind::rising;
  return is_steered ? Neighbour::Kind::steered : Neighbour::Kind::held;
}

std::optional<Neighbour> DroneLink::as_neighbour(TimeNs now) noexcept {
  const Pose& pose = position_.pose();
  // Of one in the air an old place is better than none.
  if (!in_common_frame_ || pose.stamp_ns == 0) return std::nullopt;
  const double sigma_m = std::sqrt(static_cast<double>(std::max(pose.variance[0], pose.variance[1])));
  if (sigma_m > max_sigma_m) return std::nullopt;
  if (!session_.is_possibly_in_flight() && now - pose.stamp_ns > failsafe_settings_.pose_lost_ns) return std::nullopt;
  const Playout::CurrentSetpoint setpoint = setpoints_.desired(now, orders_.is_landing_requested());
  const bool flying = session_.phase() == LinkPhase::flying;
  const bool steered = flying && (orders_.is_landing_requested() || follows_plan(failsafe_.mode, setpoint.valid));
  Neighbour out{.number = number_,
                .kind = kind_as_neighbour(steered),
                .motion = {.position_m = position_.position_m(),
                           .velocity_mps = pose.velocity_mps,
                           .late_s = to_seconds(position_.pose_came_ns() - pose.stamp_ns),
                           .age_s = to_seconds(now - pose.stamp_ns),
                           .blur_m = blur_sigmas * sigma_m},
                .can_step_aside = flying && failsafe_.mode == FailsafeMode::hold && is_placed(now),
                .lands = orders_.is_landing_requested(),
                .floor_m = fence_.min_m[2],
                .ceiling_m = fence_.max_m[2]};
  if (flying) {
    const Velocity& limited = setpoints_.limited();
    for (std::size_t i = 0; i < 3; ++i) out.motion.sent_mps[i] = static_cast<double>(limited.mps[i]);
  }
  if (!steered) return out;
  const Velocity inside = clip_at_fence(setpoints_.drawn_fence(), out.motion.position_m, session_.state().height_m,
                                        velocity_for(now, setpoint, true), push_mps(now));
  for (std::size_t i = 0; i < 3; ++i) out.desired_mps[i] = static_cast<double>(inside.mps[i]);
  return out;
}

void DroneLink::sample(const LinkMoment& at) noexcept {
  const TimeNs state_ns = session_.state_at_ns();
  const TelloState& state = session_.state();
  const PlanCounters& plans = admission_.counters();
  const Pose& pose = position_.published_pose();
  reporting_.publish(at, {.phase = session_.phase(),
                          .mode = failsafe_.mode,
                          .cause = failsafe_.cause,
                          .pose_stamp_ns = pose.stamp_ns,
                          .position_m = pose.position_m,
                          .velocity_mps = pose.velocity_mps,
                          .yaw_rad = pose.yaw_rad,
                          .battery = state.battery,
                          .tof_m = state.tof_m,
                          .height_m = state.height_m,
                          .sdk_state_fresh = state_ns != 0 && at.now - state_ns <= failsafe_settings_.state_stale_ns,
                          .playout_margin_ns = setpoints_.margin_ns(),
                          .sent_velocity_mps = setpoints_.sent().mps,
                          .sent_yaw_rate_radps = setpoints_.sent().yaw_radps,
                          .attitude_rad = attitude_rad(state),
                          .acceleration_mps2 = acceleration_mps2(state),
                          .pose_variance = pose.variance,
                          .plans_late = plans.late,
                          .plans_dropped = plans.dropped,
                          .plans_applied = plans.applied,
                          .temperature_c = state.temperature_c,
                          .hot = watches_.heat.is_hot(),
                          .contested = watches_.client.is_contested(at.now),
                          .diverted = watches_.client.is_diverted(at.now)});
}

}  // namespace ledgerline::link
