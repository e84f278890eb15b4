#include "onboard/agent/core/outbox/transition_sender.hpp"

#include <algorithm>
#include <set>

#include "common/base/check.hpp"

namespace ledgerline::agent {

TransitionSender::TransitionSender(const BackOffLimits& back_off, const std::vector<DroneName>& drones,
                                   std::uint64_t seed)
    : random_(seed) {
  for (const DroneName& drone : drones) slots_.push_back(Slot{.drone = drone, .pause = BackOff(back_off)});
}

void TransitionSender::add(const Transition& transition) {
  Slot* slot = find_drone(slots_, transition.drone);
  if (!slot) return;
  if (transition.boot_id != boot_id_) {
    boot_id_ = transition.boot_id;
    for (Slot& each : slots_) each.newest = each.on_ledger = 0;
  }
  if (transition.number != std::max(slot->newest + 1, transition.oldest) || slot->kept.size() == max_kept) return;
  slot->newest = transition.number;
  slot->kept.push_back(transition);
  slot->counters.lost = transition.lost;
  ++slot->counters.taken;
  ++slot->counters.pending;
}

bool TransitionSender::is_due(const Slot& slot, TimeNs now) const {
  return !slot.kept.empty() && slot.in_flight == 0 && slot.pause.over(now);
}

void TransitionSender::add_to(Slot& slot, Sending& sending, std::size_t room) {
  slot.in_flight = std::min(slot.kept.size(), room);
  slot.call = sending.number;
  sending.parts.push_back(
      {&slot.drone, {slot.kept.begin(), slot.kept.begin() + static_cast<std::ptrdiff_t>(slot.in_flight)}});
}

std::size_t TransitionSender::calls_of_many() const {
  std::set<std::uint64_t> calls;
  for (const Slot& slot : slots_) {
    if (slot.in_flight > 0 && !slot.alone) calls.insert(slot.call);
  }
  return calls.size();
}

std::optional<TransitionSender::Sending> TransitionSender::next(TimeNs now) {
  Sending sending{.number = last_call_ + 1, .parts = {}};
  const auto alone =
      std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) { return s.alone && is_due(s, now); });
  if (alone != slots_.end()) {
    add_to(*alone, sending, max_per_call);
  } else if (calls_of_many() < max_calls) {
    std::size_t room = max_per_call;
    for (Slot& slot : slots_) {
      if (room == 0 || !is_due(slot, now)) continue;
      add_to(slot, sending, room);
      room -= slot.in_flight;
    }
  }
  if (sending.parts.empty()) return std::nullopt;
  last_call_ = sending.number;
  return sending;
}

bool TransitionSender::finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome) {
  using Kind = fabric::Outcome::Kind;
  bool ours = false;
  for (Slot& slot : slots_) {
    if (slot.in_flight == 0 || slot.call != number) continue;
    ours = true;
    slot.alone = outcome.kind == Kind::refused || (slot.alone && outcome.kind != Kind::committed);
    if (outcome.kind != Kind::committed) {
      ++slot.counters.calls_repeated;
      slot.in_flight = 0;
      slot.pause.failed(now, random_);
      continue;
    }
    slot.pause.succeeded();
    slot.counters.on_ledger += slot.in_flight;
    slot.counters.pending -= slot.in_flight;
    for (; slot.in_flight > 0; --slot.in_flight) {
      if (slot.kept.front().boot_id == boot_id_) slot.on_ledger = slot.kept.front().number;
      slot.kept.pop_front();
    }
    LEDGERLINE_CHECK(slot.counters.pending == slot.kept.size(), "each transition ends on the ledger", slot.drone.name,
                     slot.counters.pending, slot.kept.size());
  }
  return ours;
}

void TransitionSender::report(AgentHeartbeat& heartbeat) const {
  heartbeat.boot_id = boot_id_;
  for (const Slot& slot : slots_) {
    heartbeat.transitions_taken.at(slot.drone.number) = slot.newest;
    heartbeat.transitions_on_ledger.at(slot.drone.number) = slot.on_ledger;
  }
}

bool TransitionSender::pending() const {
  return std::any_of(slots_.begin(), slots_.end(), [](const Slot& s) { return !s.kept.empty(); });
}

TransitionSender::Counters TransitionSender::counters(DroneNumber drone) const {
  const Slot* slot = find_drone(slots_, drone);
  return slot ? slot->counters : Counters{};
}

}  // namespace ledgerline::agent
