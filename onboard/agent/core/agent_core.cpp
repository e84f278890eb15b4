#include "onboard/agent/core/agent_core.hpp"

#include <algorithm>
#include <utility>

#include "common/access/stops.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::agent {
namespace {

constexpr TimeNs stop_gap_ns = 100 * ns_per_ms;    // between two times that one stop is said to link
constexpr TimeNs calm_stop_gap_ns = 1 * ns_per_s;  // the same on the ground, or without state, perhaps for hours
constexpr TimeNs state_counts_ns =
    3 * ns_per_s;  // of a state that shows the drone on the ground: link says one a second

TraceRecord record_of(TraceKind kind, TimeNs now, DroneNumber drone, std::uint64_t id, TimeNs stamp_ns,
                      std::uint64_t extra = 0) {
  return {.t_ns = now,
          .kind = kind,
          .drone = drone,
          .extra = static_cast<std::uint32_t>(extra),
          .id = id,
          .stamp_ns = stamp_ns};
}

}  // namespace

void AgentOutputs::clear() {
  submits.clear();
  plans.clear();
  poses.clear();
  heartbeat.reset();
  traces.clear();
  evictions.clear();
  unconfirmed_stops.clear();
  violations.clear();
}

void LedgerLiveness::on_progress() {
  ever_progress_ = true;
  unanswered_since_ns_.reset();
}

void LedgerLiveness::on_connection(TimeNs now, bool connected) {
  if (connected) {
    disconnected_since_ns_.reset();
  } else if (!disconnected_since_ns_) {
    disconnected_since_ns_ = now;
  }
}

bool LedgerLiveness::is_alive(TimeNs now) const {
  const auto too_long = [&](const std::optional<TimeNs>& since) { return since && now - *since > silent_after_ns_; };
  return ever_progress_ && !too_long(unanswered_since_ns_) && !too_long(disconnected_since_ns_);
}

AgentCore::AgentCore(AgentCoreSettings settings, crypto::MspRegistry& registry)
    : settings_(std::move(settings)),
      batcher_(settings_.batch, settings_.drones, settings_.seed),
      transitions_(settings_.batch.back_off, settings_.drones, settings_.seed + 1),
      stop_applier_(settings_.batch.back_off, settings_.drones, settings_.seed + 2),
      idle_(settings_.idle_evict_ns, settings_.batch.back_off, settings_.drones, settings_.seed + 3),
      alarms_(settings_.batch.back_off, settings_.drones, settings_.seed + 4),
      check_(settings_.check, settings_.drones, registry),
      integrity_(settings_.integrity_hold_ns),
      liveness_(settings_.ledger_silent_after_ns) {
  for (const DroneName& drone : settings_.drones)
    drones_.push_back({.drone = drone, .fusion = Fusion(settings_.fusion)});
}

void AgentCore::set_control(TimeNs now, const Control& control) {
  check_.control().set_control(control);
  const Drone* drone = find_drone(drones_, control.drone());
  // Whether its stops were applied before this agent's start the record does not say; an apply_stops that changes
  // nothing writes nothing.
  if (drone && (is_stopped(control) || !control.revoked().empty())) stop_applier_.request(now, drone->drone.number);
}

void AgentCore::on_state(TimeNs now, const StateSample& sample, AgentOutputs& out) {
  Drone* drone = find_drone(drones_, sample.drone);
  if (!drone) return;
  drone->newest = sample;
  drone->newest_ns = now;
  out.traces.push_back(record_of(TraceKind::state_taken, now, sample.drone, sample.sequence, sample.stamp_ns));
  batcher_.add(now, sample);
  repeat_stop(now, sample, *drone, out);
}

// The events of stops and their ends come once; agent or link may have been down then, or the plan may not have reached
// link. So it is said again until link's states agree with the ledger's record.
void AgentCore::repeat_stop(TimeNs now, const StateSample& sample, Drone& drone, AgentOutputs& out) {
  if (now < drone.next_stop_ns) return;
  const bool grounded = is_on_ground(sample.phase), link_has_stop = sample.cause == FailsafeCause::stopped;
  auto plan = check_.standing_stop(now, sample.drone);
  if (plan) {
    // A link that does not see the drone may have to land it without state; a new one knows of no stop.
    const bool obeyed = grounded ? link_has_stop
                        : plan->action == PlanAction::cut
                            ? sample.mode == FailsafeMode::cut
                            : sample.mode >= FailsafeMode::land || sample.phase == LinkPhase::landing;
    if (grounded && link_has_stop) check_.control().on_landed(sample.drone);
    if (obeyed) return;
  } else {
    if (!grounded || !link_has_stop) return;  // or link's own: that one stands
    plan = check_.no_stop(now, sample.drone);
    if (!plan) return;
  }
  drone.next_stop_ns = now + (is_in_flight(sample.phase) ? stop_gap_ns : calm_stop_gap_ns);
  plan->verified_ns = now;
  out.plans.push_back(*plan);
}

void AgentCore::on_mocap(TimeNs, DroneNumber drone, const MocapPose& measured, AgentOutputs& out) {
  Drone* ours = find_drone(drones_, drone);
  if (!ours) return;
  const bool flies = ours->newest && is_in_flight(ours->newest->phase);
  if (auto pose = ours->fusion.add(measured, flies)) {
    pose->drone = drone;
    ours->has_pose = true;
    out.poses.push_back(*pose);
  }
}

void AgentCore::on_outcome(TimeNs now, std::uint64_t call_number, const fabric::Outcome& outcome, AgentOutputs& out) {
  const CheckScope scope(checks_);
  const std::uint64_t number = call_number / senders;
  bool is_ours = false;
  switch (static_cast<Sender>(call_number % senders)) {
    case Sender::batcher:
      is_ours = end_batch(now, number, outcome, out);
      break;
    case Sender::transitions:
      is_ours = transitions_.finished(now, number, outcome);
      break;
    case Sender::stop_applier:
      is_ours = stop_applier_.finished(now, number, outcome);
      break;
    case Sender::idle_evictor:
      is_ours = end_eviction(now, number, outcome, out);
      break;
    case Sender::alarms:
      is_ours = alarms_.finished(now, number, outcome);
      break;
  }
  if (is_ours && outcome.kind == fabric::Outcome::Kind::committed) liveness_.on_progress();
}

bool AgentCore::end_batch(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome, AgentOutputs& out) {
  const auto ended = batcher_.finished(now, number, outcome);
  if (!ended) return false;
  if (outcome.endorsed_ns != 0)
    out.traces.push_back(record_of(TraceKind::call_endorsed, outcome.endorsed_ns, 0, number, ended->submitted_ns));
  if (outcome.ordered_ns != 0)
    out.traces.push_back(record_of(TraceKind::call_ordered, outcome.ordered_ns, 0, number, ended->submitted_ns));
  if (outcome.kind == fabric::Outcome::Kind::invalidated && outcome.code == protos::ENDORSEMENT_POLICY_FAILURE) {
    // The contract has become a newer version, and our records have no policy yet: apply_stops renews them.
    stop_applier_.request_renewal(now);
  }
  if (outcome.kind != fabric::Outcome::Kind::committed) return true;
  stop_applier_.on_renewed();
  out.traces.push_back(
      record_of(TraceKind::batch_committed, now, 0, number, ended->submitted_ns, ended->samples.size()));
  return true;
}

void AgentCore::on_block(TimeNs now, const fabric::Block& block, AgentOutputs& out) {
  const CheckScope scope(checks_);
  for (const DroneName& drone : settings_.drones) check_.set_evicting(drone.number, idle_.is_evicting(drone.number));
  auto checked = check_.check(now, (now + real_offset_ns_) / ns_per_s, block);
  for (const auto& refused : checked.refused) {
    out.traces.push_back(record_of(TraceKind::refused, now, refused.drone, refused.sequence, refused.state_stamp_ns,
                                   static_cast<std::uint64_t>(refused.why)));
  }
  add_violations(now, block, checked);
  validated_share_.add(now, block);
  if (!checked.chain_ok) {
    last_chain_error_ = checked.chain_error;
    return;
  }
  ++blocks_;
  liveness_.on_progress();
  apply(now, block, checked, out);
}

void AgentCore::on_refused_block(TimeNs now, const fabric::Block& block, AgentOutputs& out) {
  const CheckScope scope(checks_);
  const auto checked = check_.check_refused(now, block);
  add_violations(now, block, checked);
  apply(now, block, checked, out);
}

void AgentCore::apply(TimeNs now, const fabric::Block& block, const CheckedBlock& checked, AgentOutputs& out) {
  for (const Plan& plan : checked.plans) {
    if (is_contract_action(plan.action) && !is_contract_stop(plan.action)) continue;
    if (plan.action == PlanAction::fly && plan.count == 0) continue;
    if (block.received_ns != 0)
      out.traces.push_back(
          record_of(TraceKind::command_in_block, block.received_ns, plan.drone, plan.sequence, plan.state_stamp_ns));
    if (is_contract_stop(plan.action)) stop_applier_.request(now, plan.drone);  // a stop or cut of the ledger's
    out.traces.push_back(record_of(TraceKind::command_taken, now, plan.drone, plan.sequence, plan.state_stamp_ns));
  }
  out.unconfirmed_stops.insert(out.unconfirmed_stops.end(), checked.unconfirmed.begin(), checked.unconfirmed.end());
  for (const DroneNumber drone : checked.revoked) stop_applier_.request(now, drone);
  for (const DroneNumber drone : checked.commanded) idle_.on_command(now, drone);
  checked_.insert(checked_.end(), checked.plans.begin(), checked.plans.end());
}

void AgentCore::add_violations(TimeNs now, const fabric::Block& block, const CheckedBlock& checked) {
  if (!checked.chain_ok) integrity_.add(now, IntegrityViolation::chain, block.number, checked.chain_error);
  integrity_.add(now, IntegrityViolation::transaction, block.number, checked.unverified_problem, checked.unverified);
  for (const auto& stop : checked.unconfirmed) {
    if (stop.validated) continue;  // it came to nothing, by our own validation as well
    integrity_.add(now, IntegrityViolation::stop, block.number,
                   "drone " + std::to_string(stop.drone) + ": stopped by " + stop.stopper.msp_id + " " +
                       stop.stopper.subject + ", which the block flags " + std::to_string(stop.code));
  }
}

void AgentCore::hand_over_plans(TimeNs now, AgentOutputs& out) {
  for (Plan& plan : checked_) {
    Drone* drone = find_drone(drones_, plan.drone);
    if (!LEDGERLINE_CHECK(drone, "a verified plan is for a drone of this agent", plan.drone)) continue;
    plan.verified_ns = now;
    const bool empty = plan.action == PlanAction::fly && plan.count == 0;  // nobody's: what was flown ends
    if (!is_contract_action(plan.action) && !empty) {
      drone->last_command_verified_ns = now;
      drone->two_way.add(now - plan.state_stamp_ns);
      out.traces.push_back(record_of(TraceKind::command_verified, now, plan.drone, plan.sequence, plan.state_stamp_ns));
    }
    out.plans.push_back(plan);
  }
  checked_.clear();
}

void AgentCore::submit(TimeNs now, Sender sender, std::uint64_t number, fabric::Call call, AgentOutputs& out) {
  liveness_.on_call(now);
  const std::uint64_t call_number = number * senders + static_cast<std::uint64_t>(sender);
  out.submits.push_back({call_number, std::move(call), sender != Sender::batcher});
}

void AgentCore::submit_batch(TimeNs now, AgentOutputs& out) {
  const auto batch = batcher_.next(now);
  if (!batch) return;
  for (const StateSample& sample : batch->samples) {
    check_.add_sent_state(sample);
    out.traces.push_back(
        record_of(TraceKind::state_batched, now, sample.drone, sample.sequence, sample.stamp_ns, batch->number));
  }
  out.traces.push_back(record_of(TraceKind::batch_submitted, now, 0, batch->number, 0, batch->samples.size()));
  submit(now, Sender::batcher, batch->number, encode_batch(*batch, settings_.drones, real_offset_ns_), out);
}

void AgentCore::submit_evictions(TimeNs now, AgentOutputs& out) {
  for (const Drone& drone : drones_) {
    const bool counts = drone.newest && now - drone.newest_ns <= state_counts_ns;
    idle_.update(now, drone.drone.number,
                 {.lease = control().lease(drone.drone.number),
                  .on_ground = counts && is_on_ground(drone.newest->phase),
                  .ledger_alive = ledger_alive(now)});
  }
  while (const auto sending = idle_.next(now)) {
    submit(now, Sender::idle_evictor, sending->number, encode_evict(*sending), out);
    out.evictions.push_back({sending->drone->name, std::nullopt, {}});
  }
}

bool AgentCore::end_eviction(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome, AgentOutputs& out) {
  const auto ended = idle_.finished(now, number, outcome);
  if (ended && ended->next) out.evictions.push_back({ended->drone->name, ended->next, outcome.message});
  return ended.has_value();
}

// A heartbeat without a pose says that the pose is lost. An agent that was started again in mid-flight has not lost it,
// only not yet heard it.
bool AgentCore::may_send_heartbeat(TimeNs now) const {
  return now - *first_step_ns_ >= settings_.first_heartbeat_wait_ns ||
         std::all_of(drones_.begin(), drones_.end(), [](const Drone& d) { return d.has_pose; });
}

void AgentCore::step(TimeNs now, AgentOutputs& out) {
  const CheckScope scope(checks_);
  LEDGERLINE_CHECK(now >= stepped_ns_, "time does not go back", now, stepped_ns_);
  stepped_ns_ = now;
  if (!first_step_ns_) first_step_ns_ = now;
  hand_over_plans(now, out);
  while (const auto sending = stop_applier_.next(now))
    submit(now, Sender::stop_applier, sending->number, encode_apply_stops(*sending), out);
  while (const auto sending = transitions_.next(now))
    submit(now, Sender::transitions, sending->number, encode_transitions(*sending, real_offset_ns_), out);
  log_violations(now, out);
  if (submitting_) {
    if (const auto sending = alarms_.next(now, integrity_))
      submit(now, Sender::alarms, sending->number, encode_alarm(*sending, integrity_, now, real_offset_ns_), out);
    submit_evictions(now, out);
    submit_batch(now, out);
  }
  if (now >= next_heartbeat_ns_ && may_send_heartbeat(now)) {
    out.heartbeat = AgentHeartbeat{.stamp_ns = now,
                                   .ledger_alive = ledger_alive(now),
                                   .ledger_untrusted = integrity_.stands(now),
                                   .check_failed = checks_.failed()};
    transitions_.report(*out.heartbeat);
    // Heartbeats keep their grid, except after a pause: then none are made up for.
    const bool paused = next_heartbeat_ns_ + settings_.heartbeat_period_ns <= now;
    next_heartbeat_ns_ = (paused ? now : next_heartbeat_ns_) + settings_.heartbeat_period_ns;
  }
}

TimeNs AgentCore::due_ns() const {
  const TimeNs batch_ns = submitting_ ? batcher_.due_ns(stepped_ns_) : INT64_MAX;
  // One that is over already waits for poses, which come with a step of their own.
  return next_heartbeat_ns_ > stepped_ns_ ? std::min(batch_ns, next_heartbeat_ns_) : batch_ns;
}

DroneReport AgentCore::report(DroneNumber drone) const {
  DroneReport report;
  const Drone* ours = find_drone(drones_, drone);
  if (!ours) return report;
  report.states = batcher_.counters(drone);
  report.transitions = transitions_.counters(drone);
  report.commands = check_.counters(drone);
  report.mocap = ours->fusion.counters();
  report.newest = ours->newest;
  report.last_command_verified_ns = ours->last_command_verified_ns;
  report.two_way = ours->two_way;
  return report;
}

void AgentCore::log_violations(TimeNs now, AgentOutputs& out) {
  for (auto& entry : integrity_.pop_log_entries(now)) out.violations.push_back(std::move(entry));
}

}  // namespace ledgerline::agent
