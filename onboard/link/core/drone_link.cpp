#include "onboard/link/core/drone_link.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "onboard/link/core/body_frame.hpp"
#include "onboard/link/core/tello/axes.hpp"

namespace ledgerline::link {
namespace {

// Where motion capture is there too, it says where the drone starts.
OdometrySettings odometry_settings_of(const DroneSettings& drone) noexcept {
  OdometrySettings settings = drone.odometry;
  if (!uses_mocap(drone.source)) return settings;
  settings.start_sigma_m = 100;    // any room
  settings.correction_mps = 1000;  // what jumps is held back behind it, by Failover
  settings.start_sigma_rad = std::numbers::pi;
  return settings;
}

}  // namespace

DroneLink::DroneLink(const DroneSettings& drone, const LinkSettings& settings, std::uint64_t boot_id, bool local_stop)
    : name_(drone.name),
      number_(drone.number),
      boot_id_(boot_id),
      failsafe_settings_(settings.failsafe),
      fence_(settings.fence),
      rc_settings_(settings.rc),
      source_(drone.source),
      by_hand_without_pose_(drone.by_hand_without_pose),
      odometry_(odometry_settings_of(drone)),
      velocity_known_(drone.velocity_known),
      failover_(drone.odometry_after_ns, drone.odometry.correction_mps),
      pads_(drone.source == PoseSource::pads ? settings.pads : std::vector<PadSettings>{}),
      session_(settings.session, drone.serial, drone.source == PoseSource::pads),
      admission_(settings.playout),
      playout_(settings.playout, admission_),
      limiter_(settings.playout),
      in_common_frame_(drone.in_common_frame),
      landing_(from_seconds(settings.separation.landing_wait_s)),
      drawn_fence_(settings.fence),
      local_stop_(local_stop) {}

void DroneLink::take_bytes(TimeNs now, Port port, std::string_view bytes) noexcept {
  if (port == Port::answer) {
    session_.on_answer(now, bytes);
    client_watch_.on_answer(now);
  } else if (session_.on_state(now, bytes)) {
    take_state(now, session_.state());
  }
}

void DroneLink::take_heartbeat(const AgentHeartbeat& heartbeat) noexcept {
  facts_.heartbeat_ns = heartbeat.stamp_ns;
  facts_.ledger_alive = heartbeat.ledger_alive;
  facts_.ledger_untrusted = heartbeat.ledger_untrusted;
  const bool of_this_boot = heartbeat.boot_id == boot_id_;  // a restarted agent knows of no boot
  const std::size_t i = std::min(number_, max_drones);
  transitions_.heard(of_this_boot ? heartbeat.transitions_taken[i] : 0,
                     of_this_boot ? heartbeat.transitions_on_ledger[i] : 0);
}

void DroneLink::take_plan(const LinkMoment& at, const Plan& plan) noexcept {
  at.out.trace.push({.t_ns = at.now,
                     .kind = TraceKind::plan_received,
                     .drone = number_,
                     .extra = static_cast<std::uint32_t>(playout_.margin_ns() / ns_per_us),
                     .id = plan.sequence,
                     .stamp_ns = plan.state_stamp_ns,
                     .v = {}});
  if (admission_.admit(at.now, plan) != DropReason::none) return;
  if (is_empty_plan(plan)) {
    playout_.clear(DropReason::superseded);
    admission_.applied();
    return;
  }
  if (!is_contract_word(plan.action)) {
    arrived_sequence_ = plan.sequence;
    arrived_ns_ = at.now;
  }
  const bool flies = plan.action == PlanAction::fly;
  // One that a brake drops counts all the same: by hand it may end.
  if (flies && session_.phase() == FlightPhase::flying) by_hand_ = plan.body_frame;
  const DropReason reason = flies ? may_follow(at, plan) : obey(at, plan);
  if (reason != DropReason::none) {
    admission_.dropped(plan, reason);
  } else if (flies) {
    playout_.add(at.now, plan);
  } else {
    admission_.applied();
    // A stop that is cleared is nothing that is flown.
    if (plan.action < PlanAction::stop_cleared) record_applied(at, plan.sequence, plan.state_stamp_ns, 0);
  }
}

DropReason DroneLink::may_follow(const LinkMoment& at, const Plan& plan) const noexcept {
  if (plan.state_stamp_ns < at.not_before_ns) return DropReason::too_old;
  const bool follows = failsafe_.mode == FailsafeMode::none || failsafe_.mode == FailsafeMode::hold;
  const bool flying = session_.phase() == FlightPhase::flying && !landing_.asked();
  return flying && follows && at.healthy ? DropReason::none : DropReason::not_flying;
}

DropReason DroneLink::obey(const LinkMoment& at, const Plan& plan) noexcept {
  switch (plan.action) {
    case PlanAction::takeoff:
      return take_off(at, plan);
    case PlanAction::land:
      return land(at.now);
    case PlanAction::stop:
    case PlanAction::cut:
      stop(at.now, plan);
      return DropReason::none;
    case PlanAction::stop_cleared:
    case PlanAction::stop_cleared_by_owner:
      return clear_stop(plan);
    default:
      return DropReason::bad_value;
  }
}

DropReason DroneLink::take_off(const LinkMoment& at, const Plan& plan) noexcept {
  const FlightPhase phase = session_.phase();
  if (landing_.asked()) return DropReason::not_flying;
  if (phase == FlightPhase::taking_off || phase == FlightPhase::flying) return DropReason::none;
  if (!on_ground(phase)) return DropReason::not_flying;
  if (plan.state_stamp_ns <= takeoff_after_ns_) return DropReason::too_old;
  update_facts(at, {});
  facts_.needs_position = !(plan.body_frame && by_hand_without_pose_);
  const bool refused = takeoff_refusal(failsafe_settings_, fence_, at.now, facts_) != FailsafeCause::none;
  if (refused || !session_.request_takeoff(at.now)) return DropReason::not_flying;
  by_hand_ = plan.body_frame;
  return DropReason::none;
}

DropReason DroneLink::land(TimeNs now) noexcept {
  if (session_.phase() == FlightPhase::disconnected && !session_.may_be_airborne()) return DropReason::not_flying;
  session_.land_again(now, LostLinkProtocol::Requester::holder);
  if (session_.phase() != FlightPhase::flying) {
    session_.request_land(now);
  } else {
    landing_.ask(now);  // step() sends it, in this step where nobody is below
  }
  playout_.clear(DropReason::superseded);
  return DropReason::none;
}

void DroneLink::update_facts(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint) noexcept {
  facts_.phase = session_.phase();
  facts_.may_be_airborne = session_.may_be_airborne();
  facts_.flying_since_ns = session_.phase_since_ns();
  facts_.plan_valid = setpoint.valid;
  facts_.covered_until_ns = playout_.covered_until_ns();
  facts_.state_ns = session_.state_at_ns();
  facts_.pose_ns = pose_.stamp_ns;
  for (std::size_t i = 0; i < 3; ++i) facts_.position_m[i] = pose_.position_m[i] + moved_m_[i];
  facts_.velocity_mps = pose_.velocity_mps;
  facts_.height_m = session_.state().height_m;
  facts_.battery = session_.state().battery;
  for (std::size_t i = 0; i < 3; ++i) facts_.sigma_m[i] = std::sqrt(static_cast<double>(pose_.variance[i]));
  facts_.sigma_yaw_rad = std::sqrt(static_cast<double>(pose_.variance[3]));
  const bool by_hand = setpoint.valid ? setpoint.body_frame : by_hand_;
  facts_.needs_position = !(by_hand && by_hand_without_pose_);
  // Without a pose its own height is all that is known of where it is.
  const bool placed =
      pose_.stamp_ns != 0 && (facts_.needs_position || at.now - pose_.stamp_ns < failsafe_settings_.state_stale_ns);
  update_sensing(at.now, placed);
  facts_.tilted = tilt_watch_.tilted();
  facts_.overturned = tilt_watch_.overturned();
  facts_.tilt_rad = tilt_watch_.tilt_rad();
  facts_.landing_battery = battery_watch_.needed(facts_.height_m);
  facts_.too_near = too_near();
  facts_.stop = stop_ || local_stop_ || at.stop_all;
  facts_.cut = cut_;
}

void DroneLink::step(const LinkMoment& at) noexcept {
  const TimeNs now = at.now;
  watch_phase(at);
  forget_cleared_stops();
  Playout::CurrentSetpoint setpoint = desired_setpoint(now);
  update_facts(at, setpoint);
  facts_.blind = session_.blind(now);
  failsafe_ = update(failsafe_settings_, fence_, failsafe_, now, facts_);
  obey_failsafe(now);
  if (landing_.asked() && !landing_waits(at)) session_.request_land(now);
  if (landing_.asked()) setpoint = desired_setpoint(now);
  if (session_.phase() == FlightPhase::flying) fly(at, setpoint);
  talk(at);
  watch_phase(at);
  record_transition(at);
  record_ends(at);
  report_serial(at);
}

void DroneLink::obey_failsafe(TimeNs now) noexcept {
  switch (failsafe_.mode) {
    case FailsafeMode::land:
      if (session_.phase() == FlightPhase::flying) {
        landing_.ask(now);
      } else {
        session_.request_land(now);
      }
      break;
    case FailsafeMode::cut:
      session_.request_cut(now);
      break;
    case FailsafeMode::brake:
      playout_.clear(DropReason::not_flying);
      break;
    case FailsafeMode::none:
    case FailsafeMode::hold:
      break;
  }
}

void DroneLink::talk(const LinkMoment& at) noexcept {
  for (CommandText text; session_.next_send(at.now, text);) {
    if (text.view() == rc_text({}).view()) {
      send_rc(at, {}, {});  // the one that a drone without state gets, for the trace
    } else {
      at.out.to_send.push({number_, text});
      if (text.view() == "command") client_watch_.on_command(at.now);
    }
  }
}

void DroneLink::fly(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint) noexcept {
  const TimeNs now = at.now;
  if (!at.healthy) {
    // One zero, since the drone goes on with the last rc it got; then silence: see LinkSettings::health_rest_ns.
    playout_.clear(DropReason::not_flying);
    limiter_.reset(now);
    if (last_rc_ != Rc{}) send_rc(at, {}, {});
    return;
  }
  // A drone that had to land and did not wait is not flying any more.
  const bool follows = landing_.asked() || follows_plan(failsafe_.mode, setpoint.valid);
  const double yaw = yaw_rad(now);
  const Velocity apart = left_by_others(in_map(setpoint, now));
  drawn_fence_ = fence_for(failsafe_settings_, fence_, failsafe_, now, facts_);
  const Velocity goal =
      follows || steps_aside() ? clip_at_fence(drawn_fence_, facts_.position_m, facts_.height_m, apart) : Velocity{};
  const Velocity limited = limiter_.step(now, goal, failsafe_.mode == FailsafeMode::brake);
  const BodyCommand command = to_body(rc_settings_, limited, yaw);

  const TimeNs gap = now - last_rc_ns_;
  const TimeNs wanted_gap = follows && setpoint.fresh ? rc_settings_.min_gap_ns
                            : command.rc != last_rc_  ? rc_settings_.changing_gap_ns
                                                      : rc_settings_.max_gap_ns;
  if (gap < wanted_gap) return;
  send_rc(at, command.sent, command.rc);
  if (!follows || landing_.asked()) return;
  const bool first = playout_.mark_sent();
  applied_sequence_ = setpoint.sequence;
  if (first) {
    age_.add(now - setpoint.state_stamp_ns);
    record_applied(at, setpoint.sequence, setpoint.state_stamp_ns, setpoint.fresh ? now - setpoint.meant_ns : 0);
  }
}

void DroneLink::send_rc(const LinkMoment& at, const Velocity& sent, const Rc& rc) noexcept {
  at.out.to_send.push({number_, rc_text(rc)});
  at.out.trace.push({.t_ns = at.now,
                     .kind = TraceKind::rc_sent,
                     .drone = number_,
                     .extra = 0,
                     .id = 0,
                     .stamp_ns = 0,
                     .v = {double(rc[0]), double(rc[1]), double(rc[2]), double(rc[3])}});
  last_rc_ns_ = at.now;
  last_rc_ = rc;
  sent_ = sent;
}

void DroneLink::watch_phase(const LinkMoment& at) noexcept {
  const FlightPhase phase = session_.phase();
  if (phase != last_phase_) {
    landing_.reset();
    motion_watch_.reset();
    if (phase == FlightPhase::flying) {
      limiter_.reset(at.now);
      moved_m_ = {};
    } else {
      playout_.clear(DropReason::not_flying);
      sent_ = {};
      last_rc_ = {};
      // It may hover a hand above the ground, and goes on with the last rc of a link that is gone.
      if (last_phase_ == FlightPhase::disconnected && phase == FlightPhase::on_ground) send_rc(at, {}, {});
    }
    if (in_flight(last_phase_) && !in_flight(phase)) takeoff_after_ns_ = at.now;
    if (!in_flight(phase) && !session_.may_be_airborne()) cut_ = false;
  }
  if (phase != last_phase_ || failsafe_.mode != last_mode_ || failsafe_.cause != last_cause_) {
    last_phase_ = phase;
    last_mode_ = failsafe_.mode;
    last_cause_ = failsafe_.cause;
    at.out.trace.push({.t_ns = at.now,
                       .kind = TraceKind::mode,
                       .drone = number_,
                       .extra = static_cast<std::uint32_t>(failsafe_.mode),
                       .id = static_cast<std::uint64_t>(phase),
                       .stamp_ns = 0,
                       .v = {static_cast<double>(failsafe_.cause)}});
  }
}

void DroneLink::record_transition(const LinkMoment& at) noexcept {
  Transition& last = last_transition_;
  const FlightPhase phase = session_.phase();
  const FailsafeMode mode = failsafe_.mode;
  const bool says_why = in_flight(phase) || mode >= FailsafeMode::land;
  const FailsafeCause cause = says_why ? failsafe_.cause : FailsafeCause::none;
  if (phase != last.phase || mode != last.mode || cause != last.cause) {
    last = {.drone = number_, .phase = phase, .mode = mode, .cause = cause, .boot_id = boot_id_, .stamp_ns = at.now};
    transitions_.add(last);
  }
  if (Transition next; transitions_.next(next)) at.out.transitions.push(next);
}

void DroneLink::report_serial(const LinkMoment& at) noexcept {
  const SerialCheck& serial = session_.serial();
  if (serial.verdict() == logged_serial_) return;
  logged_serial_ = serial.verdict();
  at.out.serials.push({number_, serial.verdict(), serial.answered()});
}

void DroneLink::sample(const LinkMoment& at) noexcept {
  const TimeNs now = at.now;
  const TelloSession& session = session_;
  const PlanCounters& plans = admission_.counters();
  const StateSample state{
      .drone = number_,
      .phase = session.phase(),
      .mode = failsafe_.mode,
      .cause = failsafe_.cause,
      .boot_id = boot_id_,
      .sequence = ++states_sampled_,
      .stamp_ns = now,
      .pose_stamp_ns = published_pose_.stamp_ns,
      .position_m = published_pose_.position_m,
      .velocity_mps = published_pose_.velocity_mps,
      .yaw_rad = published_pose_.yaw_rad,
      .battery = session.state().battery,
      .tof_m = session.state().tof_m,
      .height_m = session.state().height_m,
      .sdk_state_fresh = session.state_at_ns() != 0 && now - session.state_at_ns() <= failsafe_settings_.state_stale_ns,
      .applied_sequence = applied_sequence_,
      .playout_margin_ns = playout_.margin_ns(),
      .arrived_sequence = arrived_sequence_,
      .arrived_ns = arrived_ns_,
      .sent_velocity_mps = sent_.mps,
      .sent_yaw_rate_radps = sent_.yaw_radps,
      .attitude_rad = attitude_rad(session.state()),
      .acceleration_mps2 = acceleration_mps2(session.state()),
      .pose_variance = published_pose_.variance,
      .plans_late = plans.late,
      .plans_dropped = plans.dropped,
      .plans_applied = plans.applied,
      .temperature_c = session.state().temperature_c,
      .hot = heat_watch_.hot(),
      .contested = client_watch_.contested(now),
      .diverted = client_watch_.diverted(now),
  };
  at.out.states.push(state);
  at.out.trace.push({.t_ns = now,
                     .kind = TraceKind::state_sampled,
                     .drone = number_,
                     .extra = static_cast<std::uint32_t>(1000 * state.battery),
                     .id = state.sequence,
                     .stamp_ns = now,
                     .v = {state.position_m[0], state.position_m[1], state.position_m[2], state.yaw_rad}});
  const PoseVariance& sent = state.pose_variance;
  if (sent == PoseVariance{}) return;  // motion capture reports none
  at.out.trace.push({.t_ns = now,
                     .kind = TraceKind::pose_reported,
                     .drone = number_,
                     .extra = 0,
                     .id = state.sequence,
                     .stamp_ns = state.pose_stamp_ns,
                     .v = {double(sent[0]), double(sent[1]), double(sent[2]), double(sent[3])}});
}

void DroneLink::record_applied(const LinkMoment& at, std::uint64_t sequence, TimeNs state_stamp_ns,
                               TimeNs late_ns) noexcept {
  at.out.trace.push({.t_ns = at.now,
                     .kind = TraceKind::command_applied,
                     .drone = number_,
                     .extra = static_cast<std::uint32_t>(std::clamp<TimeNs>(late_ns / ns_per_us, 0, UINT32_MAX)),
                     .id = sequence,
                     .stamp_ns = state_stamp_ns,
                     .v = {sent_.mps[0], sent_.mps[1], sent_.mps[2], sent_.yaw_radps}});
}

void DroneLink::record_ends(const LinkMoment& at) noexcept {
  for (const PlanEnd& end : admission_.ends()) {
    at.out.trace.push({.t_ns = at.now,
                       .kind = TraceKind::refused,
                       .drone = number_,
                       .extra = static_cast<std::uint32_t>(end.reason),
                       .id = end.sequence,
                       .stamp_ns = end.state_stamp_ns,
                       .v = {}});
  }
  admission_.clear_ends();
}

DroneReport DroneLink::report() const {
  return {.name = name_,
          .number = number_,
          .states_sampled = states_sampled_,
          .plans = admission_.counters(),
          .transitions = transitions_.counters(),
          .age_ms = age_.quantiles_ms(),
          .heard = session_.heard(),
          .landed = session_.has_flown() && on_ground(session_.phase()),
          .phase = session_.phase()};
}

}  // namespace ledgerline::link
