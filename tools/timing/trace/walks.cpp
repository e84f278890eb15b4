#include "tools/timing/trace/walks.hpp"

#include <algorithm>

namespace ledgerline::timing {
namespace {

constexpr TimeNs calls_kept_ns = 60 * ns_per_s;  // no call is in flight for longer

constexpr TimeNs max_turn_ns = ns_per_ms;

TimeNs& at(Walk& walk, Mark mark) { return walk.at_ns[static_cast<std::size_t>(mark)]; }

void acknowledge(Walk& walk, Mark endorsed, Mark ordered, Mark block) {
  if (!walk.has(endorsed) || !walk.has(block)) return;
  at(walk, ordered) = walk.has(ordered) ? std::min(walk.at(ordered), walk.at(block)) : walk.at(block);
}

void receive(Walk& walk) {
  const TimeNs verified_ns = walk.at(Mark::verified);
  for (const Mark mark : {Mark::received, Mark::applied}) {
    if (walk.has(mark) && walk.at(mark) > verified_ns - max_turn_ns)
      at(walk, mark) = std::max(walk.at(mark), verified_ns);
  }
}

}  // namespace

Mark Walk::last() const {
  std::size_t last = 0;
  for (std::size_t i = 0; i < mark_count; ++i) last = at_ns[i] != 0 ? i : last;
  return static_cast<Mark>(last);
}

// Lateness and margin are cut to whole microseconds.
bool Walk::due_at_once() const {
  return has(Mark::applied) && has(Mark::received) &&
         at(Mark::applied) - late_ns + margin_ns - ns_per_us < at(Mark::received);
}

void Walks::add(Writer writer, std::span<const TraceRecord> records, std::uint32_t life) {
  for (const TraceRecord& record : records) {
    // Nobody's clock says this: a damaged record, and differences of such times could overflow.
    if (record.t_ns <= 0 || record.t_ns > INT64_MAX / 2) {
      ++counters_.strays;
    } else {
      add(writer, record, life);
    }
  }
}

void Walks::add(Writer writer, const TraceRecord& record, std::uint32_t life) {
  if (writer == Writer::link) {
    if (record.kind == TraceKind::state_sampled) see(record, Mark::sampled, life);
    if (record.kind == TraceKind::plan_received) see(record, Mark::received, life);
    if (record.kind == TraceKind::command_applied) see(record, Mark::applied, life);
    if (record.kind == TraceKind::setpoint_sent) see(record, Mark::sent, life);
    if (record.kind == TraceKind::setpoint_left) see(record, Mark::at_device, life);
    return;
  }
  Calls& calls = writer == Writer::agent ? frames_ : calls_;
  if (record.kind == TraceKind::call_endorsed || record.kind == TraceKind::call_ordered) {
    Call& call = calls[{life, record.id}];
    call.submitted_ns = record.stamp_ns;
    (record.kind == TraceKind::call_endorsed ? call.endorsed_ns : call.ordered_ns) = record.t_ns;
    return;
  }
  if (writer == Writer::agent) {
    if (record.kind == TraceKind::state_taken) see(record, Mark::taken, life);
    if (record.kind == TraceKind::state_batched) see(record, Mark::batched, life);
    if (record.kind == TraceKind::command_in_block) see(record, Mark::in_block, life);
    if (record.kind == TraceKind::command_taken) see(record, Mark::picked_up, life);
    if (record.kind == TraceKind::command_verified) see(record, Mark::verified, life);
  } else {
    if (record.kind == TraceKind::state_received) see(record, Mark::delivered, life);
    if (record.kind == TraceKind::command_made) see(record, Mark::made, life);
    if (record.kind == TraceKind::command_submitted) see(record, Mark::submitted, life);
  }
}

void Walks::see(const TraceRecord& record, Mark mark, std::uint32_t life) {
  Open& open = open_[{record.stamp_ns, record.drone}];
  const bool before = open.walk.has(mark);
  const bool last_counts = mark == Mark::batched || mark == Mark::submitted;
  if (before && !last_counts) {
    ++counters_.doubled;
    return;
  }
  at(open.walk, mark) = std::max(open.walk.at(mark), record.t_ns);
  if (mark == Mark::sampled) open.walk.sequence = record.id;
  if (mark == Mark::batched) open.frame = {life, record.extra};
  if (mark == Mark::submitted) open.call = {life, record.extra};
  if (mark == Mark::received) open.walk.margin_ns = static_cast<TimeNs>(record.extra) * ns_per_us;
  if (mark == Mark::applied) open.walk.late_ns = static_cast<TimeNs>(record.extra) * ns_per_us;
}

bool Walks::finish(Open& open) const {
  Walk& walk = open.walk;
  const auto frame = frames_.find(open.frame), call = calls_.find(open.call);
  if (frame != frames_.end() && walk.has(Mark::batched)) {
    at(walk, Mark::endorsed) = frame->second.endorsed_ns;
    at(walk, Mark::ordered) = frame->second.ordered_ns;
  }
  if (call != calls_.end() && walk.has(Mark::submitted)) {
    at(walk, Mark::command_endorsed) = call->second.endorsed_ns;
    at(walk, Mark::command_ordered) = call->second.ordered_ns;
  }
  acknowledge(walk, Mark::endorsed, Mark::ordered, Mark::delivered);
  acknowledge(walk, Mark::command_endorsed, Mark::command_ordered, Mark::in_block);
  receive(walk);
  if (walk.has(Mark::at_device)) at(walk, Mark::at_device) = std::max(walk.at(Mark::at_device), walk.at(Mark::sent));
  TimeNs before = 0;
  for (const TimeNs t : walk.at_ns) {
    if (t == 0) continue;
    if (t < before) return false;
    before = t;
  }
  return true;
}

std::vector<Walk> Walks::take(TimeNs sampled_before_ns) {
  std::vector<Walk> walks;
  auto it = open_.begin();
  for (; it != open_.end() && it->first.first < sampled_before_ns; ++it) {
    Open& open = it->second;
    open.walk.drone = it->first.second;
    if (!open.walk.has(Mark::sampled)) {
      ++counters_.strays;
    } else if (!finish(open)) {
      ++counters_.backwards;
    } else {
      walks.push_back(open.walk);
    }
  }
  open_.erase(open_.begin(), it);
  for (Calls* calls : {&frames_, &calls_}) {
    std::erase_if(*calls, [&](const auto& c) { return c.second.submitted_ns < sampled_before_ns - calls_kept_ns; });
  }
  return walks;
}

}  // namespace ledgerline::timing
