#include "onboard/link/core/link_core.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "onboard/link/core/body_frame.hpp"

namespace ledgerline::link {
namespace {

bool finite(const Pose& pose) noexcept {
  return std::all_of(pose.position_m.begin(), pose.position_m.end(), [](double v) { return std::isfinite(v); }) &&
         std::all_of(pose.velocity_mps.begin(), pose.velocity_mps.end(), [](double v) { return std::isfinite(v); }) &&
         std::isfinite(pose.yaw_rad);
}

// The Tello's axes are forward, right, down; REP 103's forward, left, up.
constexpr std::array<float, 3> forward_left_up{1, -1, -1};

std::array<float, 3> attitude_rad(const TelloState& state) noexcept {
  constexpr float rad_per_deg = std::numbers::pi_v<float> / 180;
  std::array<float, 3> out{};
  for (std::size_t i = 0; i < 3; ++i) out[i] = forward_left_up[i] * state.attitude_deg[i] * rad_per_deg;
  return out;
}

std::array<float, 3> acceleration_mps2(const TelloState& state) noexcept {
  constexpr float mps2_per_mg = 9.80665F / 1000;
  std::array<float, 3> out{};
  for (std::size_t i = 0; i < 3; ++i) out[i] = forward_left_up[i] * state.acceleration_mg[i] * mps2_per_mg;
  return out;
}

bool on_ground(FlightPhase phase) noexcept { return phase == FlightPhase::on_ground || phase == FlightPhase::landed; }

}  // namespace

LinkCore::LinkCore(const LinkSettings& settings, std::uint64_t boot_id, int starts)
    : settings_(settings), boot_id_(boot_id), land_first_(starts >= settings.session.many_starts) {
  drones_.reserve(settings_.drones.size());
  for (const DroneSettings& drone : settings_.drones) drones_.emplace_back(drone, settings_);
}

LinkCore::Drone* LinkCore::find(DroneNumber number) noexcept {
  const auto at = std::find_if(drones_.begin(), drones_.end(), [&](const Drone& d) { return d.number == number; });
  return at == drones_.end() ? nullptr : &*at;
}

const LinkCore::Drone* LinkCore::find(DroneNumber number) const noexcept {
  const auto at = std::find_if(drones_.begin(), drones_.end(), [&](const Drone& d) { return d.number == number; });
  return at == drones_.end() ? nullptr : &*at;
}

const LinkOutputs& LinkCore::step(TimeNs now, const LinkInputs& inputs) noexcept {
  out_.to_send.clear();
  out_.states.clear();
  out_.transitions.clear();
  out_.trace.clear();
  if (last_step_ns_ != 0 && now - last_step_ns_ > settings_.health_gap_ns)
    unhealthy_until_ns_ = now + settings_.health_rest_ns;
  if (last_step_ns_ == 0) next_sample_ns_ = now;
  if (last_step_ns_ != 0) dead_reckon(to_seconds(now - last_step_ns_));
  last_step_ns_ = now;

  take_inputs(now, inputs);
  for (Drone& drone : drones_) step_drone(now, drone);

  if (now >= next_sample_ns_) {
    // All drones at one moment, so that their samples ride in one frame.
    for (Drone& drone : drones_) sample(now, drone);
    const TimeNs period = from_seconds(1.0 / settings_.rate_hz);
    next_sample_ns_ += period;
    if (next_sample_ns_ <= now) next_sample_ns_ = now + period;
  }
  return out_;
}

void LinkCore::take_inputs(TimeNs now, const LinkInputs& inputs) noexcept {
  if ((inputs.stop_all && !stop_all_) || land_first_) {
    for (Drone& drone : drones_) drone.session.land_again(now, BlindTalk::Asker::local);
  }
  land_first_ = false;
  stop_all_ = stop_all_ || inputs.stop_all;
  for (const Received& received : inputs.received) {
    Drone* drone = find(received.drone);
    if (!drone) continue;
    if (received.port == Port::answer) {
      drone->session.on_answer(now, received.bytes);
    } else {
      drone->session.on_state(now, received.bytes);
    }
  }
  for (const AgentBeat& beat : inputs.beats) {
    if (beat.stamp_ns >= beat_.stamp_ns && beat.stamp_ns <= now) take_beat(beat);
  }
  for (const Pose& pose : inputs.poses) take_pose(now, pose);
  for (const Plan& plan : inputs.plans) take_plan(now, plan);
}

void LinkCore::take_beat(const AgentBeat& beat) noexcept {
  beat_ = beat;
  const bool of_this_boot = beat.boot_id == boot_id_;  // an agent that started anew knows of no boot
  for (Drone& drone : drones_) {
    const std::size_t i = std::min(drone.number, max_drones);
    drone.transitions.heard(of_this_boot ? beat.transitions_taken[i] : 0,
                            of_this_boot ? beat.transitions_on_ledger[i] : 0);
  }
}

void LinkCore::take_pose(TimeNs now, const Pose& pose) noexcept {
  Drone* drone = find(pose.drone);
  if (!drone || pose.stamp_ns <= drone->pose.stamp_ns || pose.stamp_ns > now || !finite(pose)) return;
  drone->pose = pose;
  drone->moved_m = {};
}

// Without a pose (agent died, its plan is flown to the end) the fence still needs to know about where the drone is.
void LinkCore::dead_reckon(double seconds) noexcept {
  for (Drone& drone : drones_) {
    for (std::size_t i = 0; i < 3; ++i) drone.moved_m[i] += static_cast<double>(drone.sent.mps[i]) * seconds;
  }
}

void LinkCore::take_plan(TimeNs now, const Plan& plan) noexcept {
  Drone* found = find(plan.drone);
  if (!found) return;
  Drone& drone = *found;
  out_.trace.push({.t_ns = now,
                   .kind = TraceKind::plan_received,
                   .drone = drone.number,
                   .extra = static_cast<std::uint32_t>(drone.playout.margin_ns() / ns_per_us),
                   .id = plan.sequence,
                   .stamp_ns = plan.state_stamp_ns,
                   .v = {}});
  if (drone.playout.admit(now, plan) != DropReason::none) return;
  if (!is_contract_stop(plan.action)) {
    drone.arrived_sequence = plan.sequence;
    drone.arrived_ns = now;
  }
  const FailsafeMode mode = drone.failsafe.mode;
  switch (plan.action) {
    case PlanAction::fly:
      if (drone.session.phase() == FlightPhase::flying && (mode == FailsafeMode::none || mode == FailsafeMode::hold) &&
          healthy(now)) {
        drone.playout.add(now, plan);
      } else {
        drone.playout.count_dropped(plan, DropReason::not_flying);
      }
      break;
    case PlanAction::takeoff:
      take_off(now, drone, plan);
      break;
    case PlanAction::land:
      land(now, drone, plan);
      break;
    case PlanAction::stop:
    case PlanAction::cut:
      drone.stop = true;
      drone.cut = drone.cut || plan.action == PlanAction::cut;
      drone.takeoff_after_ns = now;
      drone.session.land_again(now, BlindTalk::Asker::contract);
      drone.playout.clear(DropReason::superseded);
      drone.playout.count_applied();
      record_applied(now, drone, plan.sequence, plan.state_stamp_ns);
      break;
    default:
      drone.playout.count_dropped(plan, DropReason::bad_value);
  }
}

void LinkCore::take_off(TimeNs now, Drone& drone, const Plan& plan) noexcept {
  const FlightPhase phase = drone.session.phase();
  const bool met = phase == FlightPhase::taking_off || phase == FlightPhase::flying;
  if (on_ground(phase)) {
    if (plan.state_stamp_ns <= drone.takeoff_after_ns) {
      drone.playout.count_dropped(plan, DropReason::too_old);
      return;
    }
    // Agent passes on no take-off of a stopped drone: one from a state after the stop means that it was resumed.
    drone.stop = drone.cut = false;
    update_facts(drone, {});
    if (takeoff_refusal(settings_.failsafe, now, drone.facts) != FailsafeCause::none ||
        !drone.session.request_takeoff(now)) {
      drone.playout.count_dropped(plan, DropReason::not_flying);
      return;
    }
  } else if (!met) {
    drone.playout.count_dropped(plan, DropReason::not_flying);
    return;
  }
  drone.playout.count_applied();
  record_applied(now, drone, plan.sequence, plan.state_stamp_ns);
}

void LinkCore::land(TimeNs now, Drone& drone, const Plan& plan) noexcept {
  if (drone.session.phase() == FlightPhase::disconnected && !drone.session.may_fly_unseen()) {
    drone.playout.count_dropped(plan, DropReason::not_flying);
    return;
  }
  drone.session.land_again(now, BlindTalk::Asker::holder);
  drone.session.request_land(now);
  drone.playout.clear(DropReason::superseded);
  drone.playout.count_applied();
  record_applied(now, drone, plan.sequence, plan.state_stamp_ns);
}

void LinkCore::update_facts(Drone& drone, const Playout::Wish& wish) const noexcept {
  FailsafeFacts& facts = drone.facts;
  facts.phase = drone.session.phase();
  facts.may_fly_unseen = drone.session.may_fly_unseen();
  facts.flying_since_ns = drone.session.phase_since_ns();
  facts.plan_valid = wish.valid;
  facts.covered_until_ns = drone.playout.covered_until_ns();
  facts.beat_ns = beat_.stamp_ns;
  facts.ledger_alive = beat_.ledger_alive;
  facts.state_ns = drone.session.state_at_ns();
  facts.pose_ns = drone.pose.stamp_ns;
  for (std::size_t i = 0; i < 3; ++i) facts.position_m[i] = drone.pose.position_m[i] + drone.moved_m[i];
  facts.velocity_mps = drone.pose.velocity_mps;
  facts.height_m = drone.session.state().height_m;
  facts.battery = drone.session.state().battery;
  facts.stop = drone.stop || stop_all_;
  facts.cut = drone.cut;
}

void LinkCore::step_drone(TimeNs now, Drone& drone) noexcept {
  watch_phase(now, drone);
  const Playout::Wish wish = drone.playout.wish(now);
  update_facts(drone, wish);
  drone.facts.blind = drone.session.blind(now);
  drone.failsafe = update(settings_.failsafe, settings_.fence, drone.failsafe, now, drone.facts);
  obey_failsafe(now, drone);
  if (drone.session.phase() == FlightPhase::flying) fly(now, drone, wish);
  talk(now, drone);
  watch_phase(now, drone);
  record_transition(now, drone);
  record_ends(now, drone);
}

void LinkCore::obey_failsafe(TimeNs now, Drone& drone) noexcept {
  switch (drone.failsafe.mode) {
    case FailsafeMode::land:
      drone.session.request_land(now);
      break;
    case FailsafeMode::cut:
      drone.session.request_cut(now);
      break;
    case FailsafeMode::brake:
      drone.playout.clear(DropReason::not_flying);
      break;
    case FailsafeMode::none:
    case FailsafeMode::hold:
      break;
  }
}

void LinkCore::talk(TimeNs now, Drone& drone) noexcept {
  for (CommandText text; drone.session.next_send(now, text);) {
    if (text.view() == rc_text({}).view()) {
      send_rc(now, drone, {}, {});  // the one that a drone is told unseen, for the trace
    } else {
      out_.to_send.push({drone.number, text});
    }
  }
}

void LinkCore::fly(TimeNs now, Drone& drone, const Playout::Wish& wish) noexcept {
  if (!healthy(now)) {
    // One zero, since the drone goes on with the last rc it got; then silence: see LinkSettings::health_rest_ns.
    drone.playout.clear(DropReason::not_flying);
    drone.limiter.reset(now);
    if (drone.last_rc != Rc{}) send_rc(now, drone, {}, {});
    return;
  }
  const bool follows = follows_plan(drone.failsafe.mode, wish.valid);
  const Velocity goal =
      follows ? clip_at_fence(settings_.fence, drone.facts.position_m, drone.facts.height_m, wish.velocity)
              : Velocity{};
  const Velocity limited = drone.limiter.step(now, goal, drone.failsafe.mode == FailsafeMode::brake);
  const BodyCommand command = to_body(settings_.rc, limited, drone.pose.yaw_rad);

  const TimeNs gap = now - drone.last_rc_ns;
  const TimeNs wanted_gap = follows && wish.fresh         ? settings_.rc.min_gap_ns
                            : command.rc != drone.last_rc ? settings_.rc.changing_gap_ns
                                                          : settings_.rc.max_gap_ns;
  if (gap < wanted_gap) return;
  send_rc(now, drone, command.told, command.rc);
  if (!follows) return;
  const bool first = drone.playout.mark_sent();
  drone.applied_sequence = wish.sequence;
  drone.applied_stamp_ns = wish.state_stamp_ns;
  if (wish.fresh) drone.applied_late_ns = now - wish.meant_ns;
  if (first) {
    drone.age.add(now - wish.state_stamp_ns);
    record_applied(now, drone, wish.sequence, wish.state_stamp_ns, wish.fresh ? now - wish.meant_ns : 0);
  }
}

void LinkCore::send_rc(TimeNs now, Drone& drone, const Velocity& told, const Rc& rc) noexcept {
  out_.to_send.push({drone.number, rc_text(rc)});
  out_.trace.push({.t_ns = now,
                   .kind = TraceKind::rc_sent,
                   .drone = drone.number,
                   .extra = 0,
                   .id = 0,
                   .stamp_ns = 0,
                   .v = {double(rc[0]), double(rc[1]), double(rc[2]), double(rc[3])}});
  drone.last_rc_ns = now;
  drone.last_rc = rc;
  drone.sent = told;
}

void LinkCore::watch_phase(TimeNs now, Drone& drone) noexcept {
  const FlightPhase phase = drone.session.phase();
  if (phase != drone.last_phase) {
    if (phase == FlightPhase::flying) {
      drone.limiter.reset(now);
    } else {
      drone.playout.clear(DropReason::not_flying);
      drone.sent = {};
      drone.last_rc = {};
      // It may hover a hand above the ground, and goes on with the last rc of a link that is gone.
      if (drone.last_phase == FlightPhase::disconnected && phase == FlightPhase::on_ground) send_rc(now, drone, {}, {});
    }
    if (in_flight(drone.last_phase) && !in_flight(phase)) drone.takeoff_after_ns = now;
    if (!in_flight(phase) && !drone.session.may_fly_unseen()) drone.cut = false;
  }
  if (phase != drone.last_phase || drone.failsafe.mode != drone.last_mode || drone.failsafe.cause != drone.last_cause) {
    drone.last_phase = phase;
    drone.last_mode = drone.failsafe.mode;
    drone.last_cause = drone.failsafe.cause;
    out_.trace.push({.t_ns = now,
                     .kind = TraceKind::mode,
                     .drone = drone.number,
                     .extra = static_cast<std::uint32_t>(drone.failsafe.mode),
                     .id = static_cast<std::uint64_t>(phase),
                     .stamp_ns = 0,
                     .v = {static_cast<double>(drone.failsafe.cause)}});
  }
}

void LinkCore::record_transition(TimeNs now, Drone& drone) noexcept {
  Transition& last = drone.last_transition;
  const FlightPhase phase = drone.session.phase();
  const FailsafeMode mode = drone.failsafe.mode;
  const bool says_why = in_flight(phase) || mode >= FailsafeMode::land;
  const FailsafeCause cause = says_why ? drone.failsafe.cause : FailsafeCause::none;
  if (phase != last.phase || mode != last.mode || cause != last.cause) {
    last = {.drone = drone.number, .phase = phase, .mode = mode, .cause = cause, .boot_id = boot_id_, .stamp_ns = now};
    drone.transitions.add(last);
  }
  if (Transition next; drone.transitions.next(next)) out_.transitions.push(next);
}

void LinkCore::sample(TimeNs now, Drone& drone) noexcept {
  const TelloSession& session = drone.session;
  const PlanCounters& plans = drone.playout.counters();
  const StateSample state{
      .drone = drone.number,
      .phase = session.phase(),
      .mode = drone.failsafe.mode,
      .cause = drone.failsafe.cause,
      .boot_id = boot_id_,
      .sequence = ++drone.states_sampled,
      .stamp_ns = now,
      .pose_stamp_ns = drone.pose.stamp_ns,
      .position_m = drone.pose.position_m,
      .velocity_mps = drone.pose.velocity_mps,
      .yaw_rad = drone.pose.yaw_rad,
      .battery = session.state().battery,
      .tof_m = session.state().tof_m,
      .height_m = session.state().height_m,
      .sdk_state_fresh = session.state_at_ns() != 0 && now - session.state_at_ns() <= settings_.failsafe.state_stale_ns,
      .applied_sequence = drone.applied_sequence,
      .applied_stamp_ns = drone.applied_stamp_ns,
      .applied_late_ns = drone.applied_late_ns,
      .arrived_sequence = drone.arrived_sequence,
      .arrived_ns = drone.arrived_ns,
      .sent_velocity_mps = drone.sent.mps,
      .sent_yaw_rate_radps = drone.sent.yaw_radps,
      .plans_late = plans.late,
      .plans_dropped = plans.dropped,
      .plans_applied = plans.applied,
      .attitude_rad = attitude_rad(session.state()),
      .acceleration_mps2 = acceleration_mps2(session.state()),
  };
  out_.states.push(state);
  out_.trace.push({.t_ns = now,
                   .kind = TraceKind::state_sampled,
                   .drone = drone.number,
                   .extra = static_cast<std::uint32_t>(1000 * state.battery),
                   .id = state.sequence,
                   .stamp_ns = now,
                   .v = {state.position_m[0], state.position_m[1], state.position_m[2], state.yaw_rad}});
}

void LinkCore::record_applied(TimeNs now, const Drone& drone, std::uint64_t sequence, TimeNs state_stamp_ns,
                              TimeNs late_ns) noexcept {
  out_.trace.push({.t_ns = now,
                   .kind = TraceKind::command_applied,
                   .drone = drone.number,
                   .extra = static_cast<std::uint32_t>(std::clamp<TimeNs>(late_ns / ns_per_us, 0, UINT32_MAX)),
                   .id = sequence,
                   .stamp_ns = state_stamp_ns,
                   .v = {drone.sent.mps[0], drone.sent.mps[1], drone.sent.mps[2], drone.sent.yaw_radps}});
}

void LinkCore::record_ends(TimeNs now, Drone& drone) noexcept {
  for (const PlanEnd& end : drone.playout.ends()) {
    out_.trace.push({.t_ns = now,
                     .kind = TraceKind::refused,
                     .drone = drone.number,
                     .extra = static_cast<std::uint32_t>(end.reason),
                     .id = end.sequence,
                     .stamp_ns = end.state_stamp_ns,
                     .v = {}});
  }
  drone.playout.clear_ends();
}

}  // namespace ledgerline::link
