#include "onboard/link/link_loop.hpp"

#include <cerrno>
#include <ctime>

namespace ledgerline::link {

TimeNs LinkLoop::sleep_until_next(TimeNs due) noexcept {
  const timespec at{static_cast<time_t>(due / ns_per_s), static_cast<long>(due % ns_per_s)};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) == EINTR) {
  }
  return monotonic_ns();
}

void LinkLoop::run() noexcept {
  const TimeNs period = from_seconds(1.0 / settings_.loop_hz);
  TimeNs due = monotonic_ns() + period;
  TimeNs give_up_ns = 0;
  while (true) {
    const TimeNs now = sleep_until_next(due);
    const TimeNs late = now - due;
    figures_.lateness.add(late);
    ++figures_.cycles;
    if (late > period) {
      // The missed turns are not made up for: a burst of old turns helps nobody.
      ++figures_.overruns;
      figures_.trace_lost +=
          trace_.push({.t_ns = now, .kind = TraceKind::late_turn, .id = figures_.cycles, .stamp_ns = due}) ? 0 : 1;
      due = now;
    }
    due += period;

    const bool stopping = stop_.load(std::memory_order_relaxed);
    turn(now, stopping);
    turns_.store(figures_.cycles, std::memory_order_relaxed);
    if (!stopping) continue;
    if (give_up_ns == 0) give_up_ns = now + settings_.landing_bound_ns;
    if (core_.all_on_ground() || now >= give_up_ns) break;
  }
  ended_.store(true, std::memory_order_release);
}

void LinkLoop::turn(TimeNs now, bool stopping) noexcept {
  std::size_t plans = 0, poses = 0, beats = 0;
  while (beats < max_beats && end_.take_beat(beats_[beats])) ++beats;
  while (poses < max_poses && end_.take_pose(poses_[poses])) ++poses;
  while (plans < max_plans && end_.take_plan(plans_[plans])) ++plans;

  const LinkOutputs& out = core_.step(now, {.received = sockets_.receive(),
                                            .plans = {plans_.data(), plans},
                                            .poses = {poses_.data(), poses},
                                            .beats = {beats_.data(), beats},
                                            .stop_all = stopping});
  for (const ToSend& message : out.to_send) figures_.sends_failed += sockets_.send(message) ? 0 : 1;
  for (const StateSample& state : out.states) {
    courier_.put(state);
    // Only shown to people: a full ring of these is no loss.
    (void)states_.push(state);
  }
  // What cannot be handed over, or nobody takes, the core gives again after agent's next beat.
  for (const Transition& transition : out.transitions) courier_.put(transition);
  if (!out.states.empty() || !out.transitions.empty()) courier_.wake();
  for (const TraceRecord& record : out.trace) figures_.trace_lost += trace_.push(record) ? 0 : 1;
}

}  // namespace ledgerline::link
