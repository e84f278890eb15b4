#include "onboard/agent/core/outbox/transition_sender.hpp"

#include <algorithm>

namespace ledgerline::agent {

TransitionSender::TransitionSender(const BatchConfig& config, const std::vector<DroneName>& drones, std::uint64_t seed)
    : random_(seed) {
  for (const DroneName& drone : drones)
    slots_.push_back(Slot{.drone = drone, .pause{config.first_back_off_ns, config.max_back_off_ns}});
}

void TransitionSender::add(const Transition& transition) {
  const auto slot =
      std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) { return s.drone.number == transition.drone; });
  if (slot == slots_.end()) return;
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

std::optional<TransitionSender::Sending> TransitionSender::next(TimeNs now) {
  const auto slot = std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) {
    return !s.kept.empty() && s.in_flight == 0 && s.pause.over(now);
  });
  if (slot == slots_.end()) return std::nullopt;
  slot->in_flight = std::min(slot->kept.size(), max_per_call);
  slot->call = ++last_call_;
  return Sending{
      .number = slot->call,
      .drone = &slot->drone,
      .transitions = {slot->kept.begin(), slot->kept.begin() + static_cast<std::ptrdiff_t>(slot->in_flight)}};
}

bool TransitionSender::finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome) {
  const auto slot =
      std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) { return s.in_flight > 0 && s.call == number; });
  if (slot == slots_.end()) return false;
  if (outcome.kind != fabric::Outcome::Kind::committed) {
    ++slot->counters.calls_repeated;
    slot->in_flight = 0;
    slot->pause.failed(now, random_);
    return true;
  }
  slot->pause.succeeded();
  slot->counters.on_ledger += slot->in_flight;
  slot->counters.pending -= slot->in_flight;
  for (; slot->in_flight > 0; --slot->in_flight) {
    if (slot->kept.front().boot_id == boot_id_) slot->on_ledger = slot->kept.front().number;
    slot->kept.pop_front();
  }
  return true;
}

void TransitionSender::tell(AgentBeat& beat) const {
  beat.boot_id = boot_id_;
  for (const Slot& slot : slots_) {
    beat.transitions_taken.at(slot.drone.number) = slot.newest;
    beat.transitions_on_ledger.at(slot.drone.number) = slot.on_ledger;
  }
}

bool TransitionSender::pending() const {
  return std::any_of(slots_.begin(), slots_.end(), [](const Slot& s) { return !s.kept.empty(); });
}

TransitionSender::Counters TransitionSender::counters(DroneNumber drone) const {
  const auto slot = std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) { return s.drone.number == drone; });
  return slot == slots_.end() ? Counters{} : slot->counters;
}

}  // namespace ledgerline::agent
