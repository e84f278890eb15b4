#pragma once
#include <stdexcept>
#include <vector>

#include "common/rt/loop_ticker.hpp"
#include "tools/timing/metrics.hpp"

/// SampleTraces and metrics for tests, as link, agent and ground would write them down.
namespace ledgerline::timing {

inline constexpr TimeNs start = 100 * ns_per_s;
inline constexpr TimeNs ms = ns_per_ms;

inline TraceRecord record(TraceKind kind, TimeNs t_ns, TimeNs stamp_ns, std::uint64_t id = 1, std::uint32_t extra = 0) {
  TraceRecord r;
  r.t_ns = t_ns;
  r.kind = kind;
  r.drone = 1;
  r.extra = extra;
  r.id = id;
  r.stamp_ns = stamp_ns;
  return r;
}

/// The records of one whole trace: it comes to the k-th mark k milliseconds after its sample.
struct Flight {
  std::vector<TraceRecord> link, agent, ground;

  void trace(TimeNs sampled, std::uint64_t n) {
    const auto batch = static_cast<std::uint32_t>(n), call = static_cast<std::uint32_t>(n);
    link.push_back(record(TraceKind::state_sampled, sampled, sampled, n));
    agent.push_back(record(TraceKind::state_taken, sampled + 1 * ms, sampled, n));
    agent.push_back(record(TraceKind::state_batched, sampled + 2 * ms, sampled, n, batch));
    agent.push_back(record(TraceKind::call_endorsed, sampled + 3 * ms, sampled + 2 * ms, n));
    agent.push_back(record(TraceKind::call_ordered, sampled + 4 * ms, sampled + 2 * ms, n));
    ground.push_back(record(TraceKind::state_received, sampled + 5 * ms, sampled, n));
    ground.push_back(record(TraceKind::command_made, sampled + 6 * ms, sampled, n));
    ground.push_back(record(TraceKind::command_submitted, sampled + 7 * ms, sampled, n, call));
    ground.push_back(record(TraceKind::call_endorsed, sampled + 8 * ms, sampled + 7 * ms, n));
    ground.push_back(record(TraceKind::call_ordered, sampled + 9 * ms, sampled + 7 * ms, n));
    agent.push_back(record(TraceKind::command_in_block, sampled + 10 * ms, sampled, n));
    agent.push_back(record(TraceKind::command_taken, sampled + 11 * ms, sampled, n));
    agent.push_back(record(TraceKind::command_verified, sampled + 12 * ms, sampled, n));
    link.push_back(record(TraceKind::plan_received, sampled + 13 * ms, sampled, n));
    link.push_back(record(TraceKind::command_applied, sampled + 14 * ms, sampled, n));
    link.push_back(record(TraceKind::setpoint_sent, sampled + 15 * ms, sampled, n));
    link.push_back(record(TraceKind::setpoint_left, sampled + 16 * ms, sampled, n));
  }
  TraceRecord& of(TraceKind kind) {
    for (auto* records : {&link, &agent, &ground}) {
      for (TraceRecord& r : *records) {
        if (r.kind == kind) return r;
      }
    }
    throw std::logic_error("no such record");
  }
  void lose(TraceKind kind) {
    for (auto* records : {&link, &agent, &ground})
      std::erase_if(*records, [&](const auto& r) { return r.kind == kind; });
  }
  SampleTraces traces() const {
    SampleTraces traces;
    traces.add(Writer::link, link);
    traces.add(Writer::agent, agent);
    traces.add(Writer::ground, ground);
    return traces;
  }
};

/// What link writes down of turns that were late by so many microseconds: a record for each list.
inline std::vector<TraceRecord> turns(std::initializer_list<std::vector<TimeNs>> late_us_of_each) {
  std::vector<TraceRecord> records;
  std::uint64_t number = 0;
  for (const auto& late : late_us_of_each) {
    PackedTurns packed;
    for (const TimeNs us : late) (void)packed.add(start, start + us * ns_per_us);
    records.push_back(packed.record());
    records.back().id = number;
    number += late.size();
  }
  return records;
}

inline Metrics some_figures() {
  Flight flight;
  for (std::uint64_t n = 1; n <= 100; ++n) flight.trace(start + static_cast<TimeNs>(n) * 20 * ms, n);
  Metrics metrics = make_metrics(flight.traces().pop(), turns({{5, 10, 1500}}));
  metrics.load.seconds = 10;
  metrics.load.programs = {{"agent", 10.0}, {"link", 4.5}, {"node", 60.0}};
  ThreadLoad loop;
  loop.who.program = "link";
  loop.who.name = "loop</script>";
  loop.who.policy = 1;
  loop.who.priority = 80;
  loop.who.voluntary = 10'000;
  loop.who.major_faults = 3;
  loop.cpu_percent = 4.5;
  metrics.load.threads = {loop};
  return metrics;
}

}  // namespace ledgerline::timing
