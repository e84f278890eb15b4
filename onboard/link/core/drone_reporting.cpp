#include "onboard/link/core/drone_reporting.hpp"

#include <algorithm>
#include <limits>

namespace ledgerline::link {

void DroneReporting::on_heartbeat(const AgentHeartbeat& heartbeat) noexcept {
  const bool of_this_boot = heartbeat.boot_id == boot_id_;  // a restarted agent knows of no boot
  const std::size_t i = std::min(number_, max_drones);
  transitions_.acknowledge(of_this_boot ? heartbeat.transitions_taken[i] : 0,
                           of_this_boot ? heartbeat.transitions_on_ledger[i] : 0);
}

void DroneReporting::trace(const LinkMoment& at, TraceRecord record) const noexcept {
  record.t_ns = at.now;
  record.drone = number_;
  at.out.trace.push(record);
}

void DroneReporting::record_received(const LinkMoment& at, const Plan& plan, TimeNs margin_ns) noexcept {
  trace(at, {.kind = TraceKind::plan_received,
             .extra = static_cast<std::uint32_t>(margin_ns / ns_per_us),
             .id = plan.sequence,
             .stamp_ns = plan.state_stamp_ns});
}

void DroneReporting::record_setpoint(const LinkMoment& at, const Playout::CurrentSetpoint& setpoint, bool first,
                                     const Velocity& sent) noexcept {
  applied_sequence_ = setpoint.sequence;
  if (!first) return;
  age_.add(at.now - setpoint.state_stamp_ns);
  trace_applied(at, setpoint.sequence, setpoint.state_stamp_ns, setpoint.fresh ? at.now - setpoint.meant_ns : 0, sent);
}

void DroneReporting::trace_applied(const LinkMoment& at, std::uint64_t sequence, TimeNs state_stamp_ns, TimeNs late_ns,
                                   const Velocity& sent) noexcept {
  trace(at, {.kind = TraceKind::command_applied,
             .extra = static_cast<std::uint32_t>(std::clamp<TimeNs>(late_ns / ns_per_us, 0, UINT32_MAX)),
             .id = sequence,
             .stamp_ns = state_stamp_ns,
             .v = {sent.mps[0], sent.mps[1], sent.mps[2], sent.yaw_radps}});
}

void DroneReporting::record_ends(const LinkMoment& at, PlanAdmission& admission) noexcept {
  for (const PlanEnd& end : admission.ends()) {
    trace(at, {.kind = TraceKind::refused,
               .extra = static_cast<std::uint32_t>(end.reason),
               .id = end.sequence,
               .stamp_ns = end.state_stamp_ns});
  }
  admission.clear_ends();
}

void DroneReporting::record_mode(const LinkMoment& at, LinkPhase phase, const FailsafeState& failsafe) noexcept {
  if (phase == traced_.phase && failsafe.mode == traced_.mode && failsafe.cause == traced_.cause) return;
  traced_ = {phase, failsafe.mode, failsafe.cause};
  trace(at, {.kind = TraceKind::mode,
             .extra = static_cast<std::uint32_t>(failsafe.mode),
             .id = static_cast<std::uint64_t>(phase),
             .v = {static_cast<double>(failsafe.cause)}});
}

void DroneReporting::record_transition(const LinkMoment& at, LinkPhase phase, const FailsafeState& failsafe) noexcept {
  Transition& last = last_transition_;
  const FailsafeMode mode = failsafe.mode;
  const bool says_why =
      is_in_flight(phase) || mode >= FailsafeMode::land || failsafe.cause == FailsafeCause::takeoff_refused_by_drone;
  const FailsafeCause cause = says_why ? failsafe.cause : FailsafeCause::none;
  if (phase != last.phase || mode != last.mode || cause != last.cause) {
    last = {.drone = number_, .phase = phase, .mode = mode, .cause = cause, .boot_id = boot_id_, .stamp_ns = at.now};
    transitions_.add(last);
  }
  if (Transition next; transitions_.next(next)) at.out.transitions.push(next);
}

void DroneReporting::record_serial(const LinkMoment& at, const SerialCheck& serial) noexcept {
  if (serial.verdict() == reported_serial_) return;
  reported_serial_ = serial.verdict();
  at.out.serials.push({number_, serial.verdict(), serial.answered()});
}

void DroneReporting::record_words(const LinkMoment& at, const TelloSession& session) noexcept {
  const auto record = [&](DroneWords::Kind kind, const DroneText& said, TimeNs& reported_ns) {
    if (said.at_ns == 0 || said.at_ns == reported_ns) return;
    reported_ns = said.at_ns;
    at.out.words.push({number_, kind, said.text});
  };
  record(DroneWords::Kind::takeoff_refused, session.takeoff_refusal(), reported_refusal_ns_);
  record(DroneWords::Kind::state_unreadable, session.unreadable_text(), reported_unreadable_ns_);
}

void DroneReporting::publish(const LinkMoment& at, StateSample sample) noexcept {
  sample.drone = number_;
  sample.boot_id = boot_id_;
  sample.sequence = ++states_sampled_;
  sample.stamp_ns = at.now;
  sample.applied_sequence = applied_sequence_;
  sample.arrived_sequence = arrived_.sequence;
  sample.arrived_ns = arrived_.at_ns;
  at.out.states.push(sample);
  // Without a pose only the drone's own height is known.
  constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
  const std::array own{unknown, unknown, static_cast<double>(sample.height_m)};
  const std::array<double, 3>& place_m = sample.pose_stamp_ns == 0 ? own : sample.position_m;
  trace(at, {.kind = TraceKind::state_sampled,
             .extra = static_cast<std::uint32_t>(1000 * std::max(0.0F, sample.battery)),
             .id = sample.sequence,
             .stamp_ns = at.now,
             .v = {place_m[0], place_m[1], place_m[2], sample.yaw_rad}});
  const PoseVariance& variance = sample.pose_variance;
  if (variance == PoseVariance{}) return;  // motion capture reports none
  trace(at, {.kind = TraceKind::pose_reported,
             .id = sample.sequence,
             .stamp_ns = sample.pose_stamp_ns,
             .v = {double(variance[0]), double(variance[1]), double(variance[2]), double(variance[3])}});
}

DroneReport DroneReporting::report(const TelloSession& session, const PlanCounters& plans) const {
  return {.name = name_,
          .number = number_,
          .states_sampled = states_sampled_,
          .plans = plans,
          .transitions = transitions_.counters(),
          .age_ms = age_.quantiles_ms(),
          .heard = session.has_responded(),
          .landed = session.has_flown() && is_on_ground(session.phase()),
          .phase = session.phase()};
}

}  // namespace ledgerline::link
