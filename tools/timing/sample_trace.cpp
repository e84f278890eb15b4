#include "tools/timing/sample_trace.hpp"

#include <algorithm>

namespace ledgerline::timing {
namespace {

constexpr TimeNs calls_kept_ns = 60 * ns_per_s;  // no call is in flight for longer

constexpr TimeNs max_turn_ns = ns_per_ms;

TimeNs& at(SampleTrace& trace, Mark mark) { return trace.at_ns[static_cast<std::size_t>(mark)]; }

void acknowledge(SampleTrace& trace, Mark endorsed, Mark ordered, Mark block) {
  if (!trace.has(endorsed) || !trace.has(block)) return;
  at(trace, ordered) = trace.has(ordered) ? std::min(trace.at(ordered), trace.at(block)) : trace.at(block);
}

void receive(SampleTrace& trace) {
  const TimeNs verified_ns = trace.at(Mark::verified);
  for (const Mark mark : {Mark::received, Mark::applied}) {
    if (trace.has(mark) && trace.at(mark) > verified_ns - max_turn_ns)
      at(trace, mark) = std::max(trace.at(mark), verified_ns);
  }
}

}  // namespace

Mark SampleTrace::last() const {
  std::size_t last = 0;
  for (std::size_t i = 0; i < mark_count; ++i) last = at_ns[i] != 0 ? i : last;
  return static_cast<Mark>(last);
}

// Lateness and margin are cut to whole microseconds.
bool SampleTrace::due_at_once() const {
  return has(Mark::applied) && has(Mark::received) &&
         at(Mark::applied) - late_ns + margin_ns - ns_per_us < at(Mark::received);
}

void SampleTraces::add(Writer writer, std::span<const TraceRecord> records, std::uint32_t life) {
  for (const TraceRecord& record : records) {
    // Nobody's clock says this: a damaged record, and differences of such times could overflow.
    if (record.t_ns <= 0 || record.t_ns > INT64_MAX / 2) {
      ++counters_.strays;
    } else {
      add(writer, record, life);
    }
  }
}

void SampleTraces::add(Writer writer, const TraceRecord& record, std::uint32_t life) {
  if (writer == Writer::link) {
    if (record.kind == TraceKind::state_sampled) set_mark(record, Mark::sampled, life);
    if (record.kind == TraceKind::plan_received) set_mark(record, Mark::received, life);
    if (record.kind == TraceKind::command_applied) set_mark(record, Mark::applied, life);
    if (record.kind == TraceKind::setpoint_sent) set_mark(record, Mark::sent, life);
    if (record.kind == TraceKind::setpoint_left) set_mark(record, Mark::at_device, life);
    return;
  }
  Calls& calls = writer == Writer::agent ? batches_ : calls_;
  if (record.kind == TraceKind::call_endorsed || record.kind == TraceKind::call_ordered) {
    Call& call = calls[{life, record.id}];
    call.submitted_ns = record.stamp_ns;
    (record.kind == TraceKind::call_endorsed ? call.endorsed_ns : call.ordered_ns) = record.t_ns;
    return;
  }
  if (writer == Writer::agent) {
    if (record.kind == TraceKind::state_taken) set_mark(record, Mark::taken, life);
    if (record.kind == TraceKind::state_batched) set_mark(record, Mark::batched, life);
    if (record.kind == TraceKind::command_in_block) set_mark(record, Mark::in_block, life);
    if (record.kind == TraceKind::command_taken) set_mark(record, Mark::picked_up, life);
    if (record.kind == TraceKind::command_verified) set_mark(record, Mark::verified, life);
  } else {
    if (record.kind == TraceKind::state_received) set_mark(record, Mark::delivered, life);
    if (record.kind == TraceKind::command_made) set_mark(record, Mark::made, life);
    if (record.kind == TraceKind::command_submitted) set_mark(record, Mark::submitted, life);
  }
}

void SampleTraces::set_mark(const TraceRecord& record, Mark mark, std::uint32_t life) {
  Open& open = open_[{record.stamp_ns, record.drone}];
  const bool before = open.trace.has(mark);
  const bool last_counts = mark == Mark::batched || mark == Mark::submitted;
  if (before && !last_counts) {
    ++counters_.doubled;
    return;
  }
  at(open.trace, mark) = std::max(open.trace.at(mark), record.t_ns);
  if (mark == Mark::sampled) open.trace.sequence = record.id;
  if (mark == Mark::batched) open.batch = {life, record.extra};
  if (mark == Mark::submitted) open.call = {life, record.extra};
  if (mark == Mark::received) open.trace.margin_ns = static_cast<TimeNs>(record.extra) * ns_per_us;
  if (mark == Mark::applied) open.trace.late_ns = static_cast<TimeNs>(record.extra) * ns_per_us;
}

bool SampleTraces::finish(Open& open) const {
  SampleTrace& trace = open.trace;
  const auto batch = batches_.find(open.batch), call = calls_.find(open.call);
  if (batch != batches_.end() && trace.has(Mark::batched)) {
    at(trace, Mark::endorsed) = batch->second.endorsed_ns;
    at(trace, Mark::ordered) = batch->second.ordered_ns;
  }
  if (call != calls_.end() && trace.has(Mark::submitted)) {
    at(trace, Mark::command_endorsed) = call->second.endorsed_ns;
    at(trace, Mark::command_ordered) = call->second.ordered_ns;
  }
  acknowledge(trace, Mark::endorsed, Mark::ordered, Mark::delivered);
  acknowledge(trace, Mark::command_endorsed, Mark::command_ordered, Mark::in_block);
  receive(trace);
  if (trace.has(Mark::at_device))
    at(trace, Mark::at_device) = std::max(trace.at(Mark::at_device), trace.at(Mark::sent));
  TimeNs before = 0;
  for (const TimeNs t : trace.at_ns) {
    if (t == 0) continue;
    if (t < before) return false;
    before = t;
  }
  return true;
}

std::vector<SampleTrace> SampleTraces::pop(TimeNs sampled_before_ns) {
  std::vector<SampleTrace> traces;
  auto it = open_.begin();
  for (; it != open_.end() && it->first.first < sampled_before_ns; ++it) {
    Open& open = it->second;
    open.trace.drone = it->first.second;
    if (!open.trace.has(Mark::sampled)) {
      ++counters_.strays;
    } else if (!finish(open)) {
      ++counters_.backwards;
    } else {
      traces.push_back(open.trace);
    }
  }
  open_.erase(open_.begin(), it);
  for (Calls* calls : {&batches_, &calls_}) {
    std::erase_if(*calls, [&](const auto& c) { return c.second.submitted_ns < sampled_before_ns - calls_kept_ns; });
  }
  return traces;
}

}  // namespace ledgerline::timing
