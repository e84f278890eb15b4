#include "onboard/link/shell/link_loop.hpp"

#include <utility>

#include "common/base/log.hpp"

namespace ledgerline::link {

void LinkLoop::run(LoopClock& clock) noexcept {
  TimeNs give_up_ns = 0;
  while (true) {
    const TimeNs now = clock.wait(stop_);
    if (clock.is_lost()) break;
    trace_.add_turn(clock.due_ns(), now);

    const bool stopping = stop_.load(std::memory_order_relaxed);
    turn(clock, now, stopping);
    turns_.store(++metrics_.cycles, std::memory_order_relaxed);
    if (!stopping) continue;
    if (give_up_ns == 0) give_up_ns = now + settings_.landing_bound_ns;
    if (core_.all_landed_or_commanded() || now >= give_up_ns) break;
  }
  trace_.finish();
  metrics_.trace_lost = trace_.lost();
  metrics_.overruns = clock.overruns();
  metrics_.lateness = clock.late();
  ended_.store(true, std::memory_order_release);
}

void LinkLoop::turn(const LoopClock& clock, TimeNs now, bool stopping) noexcept {
  std::size_t plans = 0, poses = 0, heartbeats = 0;
  while (heartbeats < heartbeats_.size() && end_.receive_heartbeat(heartbeats_[heartbeats])) ++heartbeats;
  while (poses < poses_.size() && end_.receive_pose(poses_[poses])) ++poses;
  while (plans < plans_.size() && end_.receive_plan(plans_[plans])) ++plans;

  const LinkOutputs& out =
      core_.step(now, {.received = transport_.receive(),
                       .plans = {plans_.data(), plans},
                       .poses = {poses_.data(), poses},
                       .heartbeats = {heartbeats_.data(), heartbeats},
                       .stop_all = stopping,
                       .suspended_ns = clock.suspended_ns(),
                       .clear_local_stops = clear_local_stops_.exchange(false, std::memory_order_relaxed)});
  if (core_.checks().failed() && !std::exchange(check_reported_, true))
    spdlog::error("a check failed, all drones land: {}", core_.checks().first());
  local_stops_.store(bits(core_.local_stops()), std::memory_order_relaxed);
  for (const Transport::AtDevice& left : transport_.at_device()) trace_.add_left(left);
  for (const ToSend& message : out.to_send) {
    trace_.begin_sending(message.drone);
    metrics_.sends_failed += transport_.send(message) ? 0 : 1;
  }
  const TimeNs sent_ns = out.to_send.empty() ? now : clock.now();
  for (const StateSample& state : out.states) {
    publisher_.put(state);
    // Only shown to people: a full ring of these is no loss.
    (void)states_.push(state);
  }
  // What cannot be handed over, or nobody takes, the core gives again after agent's next heartbeat.
  for (const Transition& transition : out.transitions) publisher_.put(transition);
  if (!out.states.empty() || !out.transitions.empty()) publisher_.wake();
  // The same: a full ring is of drones that come and go faster than a person reads.
  for (const SerialReport& reported : out.serials) (void)serials_.push(reported);
  for (const DroneWords& said : out.words) (void)words_.push(said);
  for (const TraceRecord& record : out.trace) {
    trace_.add(record);
    if (record.kind == TraceKind::command_applied) trace_.add_sent(record, sent_ns);
  }
}

void LoopTrace::add_sent(TraceRecord applied, TimeNs sent_ns) noexcept {
  applied.kind = TraceKind::setpoint_sent;
  applied.t_ns = sent_ns;
  add(applied);
  newest_sent_[applied.drone] = applied;
}

void LoopTrace::add_left(const Transport::AtDevice& left) noexcept {
  TraceRecord& record = newest_sent_[left.drone];
  if (record.kind != TraceKind::setpoint_sent) return;
  record.kind = TraceKind::setpoint_left;
  record.t_ns = left.t_ns;
  add(record);
}

}  // namespace ledgerline::link
