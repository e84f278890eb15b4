#include "onboard/agent/core/agent_core.hpp"

#include <algorithm>
#include <utility>

#include "common/msg/stops.hpp"

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

AgentCore::AgentCore(AgentConfig config, crypto::MspRegistry& registry)
    : config_(std::move(config)),
      batcher_(config_.batch, config_.drones, config_.seed),
      transitions_(config_.batch, config_.drones, config_.seed + 1),
      stop_applier_(config_.batch, config_.drones, config_.seed + 2),
      idle_(config_.idle_evict_ns, config_.batch, config_.drones, config_.seed + 3),
      alarms_(config_.batch, config_.drones, config_.seed + 4),
      check_(config_.check, config_.drones, registry),
      integrity_(config_.integrity_hold_ns) {
  for (std::size_t i = 0; i < config_.drones.size(); ++i) {
    drones_.push_back(Drone{.fusion = Fusion(config_.fusion), .newest = {}, .two_way = {}});
  }
}

std::size_t AgentCore::index(DroneNumber drone) const {
  const auto it =
      std::find_if(config_.drones.begin(), config_.drones.end(), [&](const DroneName& d) { return d.number == drone; });
  return static_cast<std::size_t>(it - config_.drones.begin());
}

void AgentCore::set_roles(verification::Roles roles) { check_.set_roles(std::move(roles)); }

void AgentCore::set_control(TimeNs now, const Control& control) {
  check_.set_control(control);
  const auto drone = std::find_if(config_.drones.begin(), config_.drones.end(),
                                  [&](const DroneName& d) { return d.name == control.drone(); });
  // Whether its stops were applied before this agent's start the record does not say; an apply_stops that changes
  // nothing writes nothing.
  if (drone != config_.drones.end() && (is_stopped(control) || !control.revoked().empty()))
    stop_applier_.want(now, drone->number);
}

void AgentCore::on_state(TimeNs now, const StateSample& sample, AgentOutputs& out) {
  const std::size_t i = index(sample.drone);
  if (i == drones_.size()) return;
  drones_[i].newest = sample;
  drones_[i].heard_ns = now;
  out.traces.push_back(record_of(TraceKind::state_taken, now, sample.drone, sample.sequence, sample.stamp_ns));
  batcher_.add(now, sample);
  repeat_stop(now, sample, out);
}

// The events of stops and their ends come once; agent or link may have been down then, or the plan may not have reached
// link. So it is said again until link's states agree with the ledger's record.
void AgentCore::repeat_stop(TimeNs now, const StateSample& sample, AgentOutputs& out) {
  Drone& drone = drones_[index(sample.drone)];
  if (now < drone.next_stop_ns) return;
  const bool grounded = on_ground(sample.phase), link_has_stop = sample.cause == FailsafeCause::stopped;
  auto word = check_.standing_stop(now, sample.drone);
  if (word) {
    // A link that does not see the drone may have to land it without state; a new one knows of no stop.
    const bool obeyed = grounded ? link_has_stop
                        : word->action == PlanAction::cut
                            ? sample.mode == FailsafeMode::cut
                            : sample.mode >= FailsafeMode::land || sample.phase == FlightPhase::landing;
    if (grounded && link_has_stop) check_.landed(sample.drone);
    if (obeyed) return;
  } else {
    if (!grounded || !link_has_stop) return;  // or link's own: that one stands
    word = check_.no_stop(now, sample.drone);
    if (!word) return;
  }
  drone.next_stop_ns = now + (in_flight(sample.phase) ? stop_gap_ns : calm_stop_gap_ns);
  word->verified_ns = now;
  out.plans.push_back(*word);
}

void AgentCore::on_mocap(TimeNs, DroneNumber drone, const MocapPose& measured, AgentOutputs& out) {
  const std::size_t i = index(drone);
  if (i == drones_.size()) return;
  const bool flies = drones_[i].newest && in_flight(drones_[i].newest->phase);
  if (auto pose = drones_[i].fusion.add(measured, flies)) {
    pose->drone = drone;
    drones_[i].has_pose = true;
    out.poses.push_back(*pose);
  }
}

void AgentCore::progress(TimeNs) {
  ever_progress_ = true;
  unanswered_since_ns_.reset();
}

constexpr int endorsement_policy_failure = 10;  // protos.TxValidationCode

void AgentCore::on_outcome(TimeNs now, std::uint64_t frame, const fabric::Outcome& outcome, AgentOutputs& out) {
  if (transitions_.finished(now, frame, outcome) || stop_applier_.finished(now, frame, outcome) ||
      alarms_.finished(now, frame, outcome) || take_eviction(now, frame, outcome, out)) {
    if (outcome.kind == fabric::Outcome::Kind::committed) progress(now);
    return;
  }
  const auto ended = batcher_.finished(now, frame, outcome);
  if (!ended) return;
  if (outcome.endorsed_ns != 0)
    out.traces.push_back(record_of(TraceKind::call_endorsed, outcome.endorsed_ns, 0, frame, ended->submitted_ns));
  if (outcome.ordered_ns != 0)
    out.traces.push_back(record_of(TraceKind::call_ordered, outcome.ordered_ns, 0, frame, ended->submitted_ns));
  if (outcome.kind == fabric::Outcome::Kind::invalidated && outcome.code == endorsement_policy_failure) {
    // The contract has become a newer version, and our records have no policy yet: apply_stops renews them.
    stop_applier_.renew(now);
  }
  if (outcome.kind != fabric::Outcome::Kind::committed) return;
  progress(now);
  stop_applier_.renewed();
  out.traces.push_back(TraceRecord{.t_ns = now,
                                   .kind = TraceKind::frame_committed,
                                   .extra = static_cast<std::uint32_t>(ended->samples.size()),
                                   .id = ended->number,
                                   .stamp_ns = ended->submitted_ns});
}

void AgentCore::on_block(TimeNs now, const fabric::Block& block, AgentOutputs& out) {
  for (const DroneName& drone : config_.drones) check_.set_evicting(drone.number, idle_.evicting(drone.number));
  auto checked = check_.check(now, (now + real_offset_ns_) / ns_per_s, block);
  for (const auto& refused : checked.refused) {
    out.traces.push_back(TraceRecord{.t_ns = now,
                                     .kind = TraceKind::refused,
                                     .drone = refused.drone,
                                     .extra = static_cast<std::uint32_t>(refused.why),
                                     .id = refused.sequence,
                                     .stamp_ns = refused.state_stamp_ns});
  }
  violation_block(now, block, checked);
  validated_share_.add(now, block);
  if (!checked.chain_ok) {
    last_chain_error_ = checked.chain_error;
    return;
  }
  ++blocks_;
  progress(now);
  take_checked(now, block, checked, out);
}

void AgentCore::on_refused_block(TimeNs now, const fabric::Block& block, AgentOutputs& out) {
  const auto checked = check_.check_refused(now, block);
  violation_block(now, block, checked);
  take_checked(now, block, checked, out);
}

void AgentCore::take_checked(TimeNs now, const fabric::Block& block, const CommandCheck::Checked& checked,
                             AgentOutputs& out) {
  for (const Plan& plan : checked.plans) {
    if (is_contract_action(plan.action) && !is_contract_stop(plan.action)) continue;
    if (plan.action == PlanAction::fly && plan.count == 0) continue;
    if (block.received_ns != 0)
      out.traces.push_back(
          record_of(TraceKind::command_in_block, block.received_ns, plan.drone, plan.sequence, plan.state_stamp_ns));
    if (is_contract_stop(plan.action)) stop_applier_.want(now, plan.drone);  // a stop or cut of the ledger's
    out.traces.push_back(record_of(TraceKind::command_taken, now, plan.drone, plan.sequence, plan.state_stamp_ns));
  }
  out.unconfirmed_stops.insert(out.unconfirmed_stops.end(), checked.unconfirmed.begin(), checked.unconfirmed.end());
  for (const DroneNumber drone : checked.revoked) stop_applier_.want(now, drone);
  for (const DroneNumber drone : checked.commanded) idle_.heard(now, drone);
  checked_.insert(checked_.end(), checked.plans.begin(), checked.plans.end());
}

void AgentCore::violation_block(TimeNs now, const fabric::Block& block, const CommandCheck::Checked& checked) {
  if (!checked.chain_ok) integrity_.add(now, IntegrityViolation::chain, block.number, checked.chain_error);
  integrity_.add(now, IntegrityViolation::transaction, block.number, checked.unverified_problem, checked.unverified);
  for (const auto& stop : checked.unconfirmed) {
    if (stop.validated) continue;  // it came to nothing, by our own validation as well
    integrity_.add(now, IntegrityViolation::stop, block.number,
                   "drone " + std::to_string(stop.drone) + ": stopped by " + stop.stopper.msp_id + " " +
                       stop.stopper.subject + ", which the block flags " + std::to_string(stop.code));
  }
}

void AgentCore::on_connection(TimeNs now, bool connected) {
  if (connected) {
    disconnected_since_ns_.reset();
  } else if (!disconnected_since_ns_) {
    disconnected_since_ns_ = now;
  }
}

bool AgentCore::ledger_alive(TimeNs now) const {
  const auto too_long = [&](const std::optional<TimeNs>& since) {
    return since && now - *since > config_.ledger_silent_after_ns;
  };
  return ever_progress_ && !too_long(unanswered_since_ns_) && !too_long(disconnected_since_ns_);
}

void AgentCore::hand_over_plans(TimeNs now, AgentOutputs& out) {
  for (Plan& plan : checked_) {
    if (!LEDGERLINE_CHECK(index(plan.drone) < drones_.size(), "a verified plan is for a drone of this agent",
                          plan.drone))
      continue;
    plan.verified_ns = now;
    const bool empty = plan.action == PlanAction::fly && plan.count == 0;  // nobody's: what was flown ends
    if (!is_contract_action(plan.action) && !empty) {
      Drone& drone = drones_[index(plan.drone)];
      drone.last_command_verified_ns = now;
      drone.two_way.add(now - plan.state_stamp_ns);
      out.traces.push_back(TraceRecord{.t_ns = now,
                                       .kind = TraceKind::command_verified,
                                       .drone = plan.drone,
                                       .id = plan.sequence,
                                       .stamp_ns = plan.state_stamp_ns});
    }
    out.plans.push_back(plan);
  }
  checked_.clear();
}

void AgentCore::submit_frame(TimeNs now, AgentOutputs& out) {
  const auto frame = batcher_.next(now);
  if (!frame) return;
  for (const StateSample& sample : frame->samples) {
    check_.sent(sample);
    out.traces.push_back(
        record_of(TraceKind::state_batched, now, sample.drone, sample.sequence, sample.stamp_ns, frame->number));
  }
  if (!unanswered_since_ns_) unanswered_since_ns_ = now;
  out.traces.push_back(TraceRecord{.t_ns = now,
                                   .kind = TraceKind::frame_submitted,
                                   .extra = static_cast<std::uint32_t>(frame->samples.size()),
                                   .id = frame->number});
  out.submits.push_back({frame->number, encode_frame(*frame, config_.drones, real_offset_ns_), false});
}

void AgentCore::submit_transitions(TimeNs now, AgentOutputs& out) {
  while (const auto sending = transitions_.next(now)) {
    if (!unanswered_since_ns_) unanswered_since_ns_ = now;
    out.submits.push_back({sending->number, encode_transitions(*sending, real_offset_ns_), true});
  }
}

void AgentCore::submit_alarm(TimeNs now, AgentOutputs& out) {
  const auto sending = alarms_.next(now, integrity_);
  if (!sending) return;
  if (!unanswered_since_ns_) unanswered_since_ns_ = now;
  out.submits.push_back({sending->number, encode_alarm(*sending, integrity_, now, real_offset_ns_), true});
}

void AgentCore::submit_apply_stops(TimeNs now, AgentOutputs& out) {
  while (const auto sending = stop_applier_.next(now)) {
    if (!unanswered_since_ns_) unanswered_since_ns_ = now;
    out.submits.push_back({sending->number, encode_apply_stops(*sending), true});
  }
}

void AgentCore::submit_evictions(TimeNs now, AgentOutputs& out) {
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    const Drone& drone = drones_[i];
    const bool seen = drone.newest && now - drone.heard_ns <= state_counts_ns;
    const DroneNumber number = config_.drones[i].number;
    idle_.see(now, number,
              {.lease = check_.lease(number),
               .on_ground = seen && on_ground(drone.newest->phase),
               .ledger_heard = ledger_alive(now)});
  }
  while (const auto sending = idle_.next(now)) {
    if (!unanswered_since_ns_) unanswered_since_ns_ = now;
    out.submits.push_back({sending->number, encode_evict(*sending), true});
    out.evictions.push_back({sending->drone->name, std::nullopt, {}});
  }
}

bool AgentCore::take_eviction(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome, AgentOutputs& out) {
  const auto ended = idle_.finished(now, number, outcome);
  if (ended && ended->next) out.evictions.push_back({ended->drone->name, ended->next, outcome.message});
  return ended.has_value();
}

// A heartbeat without a pose says that the pose is lost. An agent that was started again in mid-flight has not lost it,
// only not yet heard it.
bool AgentCore::may_send_heartbeat(TimeNs now) {
  if (!first_step_ns_) first_step_ns_ = now;
  return now - *first_step_ns_ >= config_.first_heartbeat_wait_ns ||
         std::all_of(drones_.begin(), drones_.end(), [](const Drone& d) { return d.has_pose; });
}

void AgentCore::step(TimeNs now, AgentOutputs& out) {
  const CheckScope scope(checks_);
  LEDGERLINE_CHECK(now >= stepped_ns_, "time does not go back", now, stepped_ns_);
  stepped_ns_ = now;
  hand_over_plans(now, out);
  submit_apply_stops(now, out);
  submit_transitions(now, out);
  log_violations(now, out);
  if (submitting_) {
    submit_alarm(now, out);
    submit_evictions(now, out);
    submit_frame(now, out);
  }
  if (now >= next_heartbeat_ns_ && may_send_heartbeat(now)) {
    out.heartbeat = AgentHeartbeat{.stamp_ns = now,
                                   .ledger_alive = ledger_alive(now),
                                   .ledger_untrusted = integrity_.stands(now),
                                   .check_failed = checks_.failed()};
    transitions_.tell(*out.heartbeat);
    // Heartbeats keep their grid, except after a pause: then none are made up for.
    const bool paused = next_heartbeat_ns_ + config_.heartbeat_period_ns <= now;
    next_heartbeat_ns_ = (paused ? now : next_heartbeat_ns_) + config_.heartbeat_period_ns;
  }
}

TimeNs AgentCore::due_ns() const {
  const TimeNs frame_ns = submitting_ ? batcher_.due_ns(stepped_ns_) : INT64_MAX;
  // One that is over already waits for poses, which come with a step of their own.
  return next_heartbeat_ns_ > stepped_ns_ ? std::min(frame_ns, next_heartbeat_ns_) : frame_ns;
}

DroneReport AgentCore::report(DroneNumber drone) const {
  DroneReport report;
  const std::size_t i = index(drone);
  if (i == drones_.size()) return report;
  report.states = batcher_.counters(drone);
  report.transitions = transitions_.counters(drone);
  report.commands = check_.counters(drone);
  report.mocap = drones_[i].fusion.counters();
  report.newest = drones_[i].newest;
  report.last_command_verified_ns = drones_[i].last_command_verified_ns;
  report.two_way = drones_[i].two_way;
  return report;
}

void AgentCore::log_violations(TimeNs now, AgentOutputs& out) {
  for (IntegrityMonitor::Word& word : integrity_.take_words(now)) out.violations.push_back(std::move(word));
}

}  // namespace ledgerline::agent
