#include "onboard/agent/core/outbox/idle_evictor.hpp"

#include <algorithm>

#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::agent {

IdleEvictor::IdleEvictor(TimeNs idle_ns, const BatchConfig& config, const std::vector<DroneName>& drones,
                         std::uint64_t seed)
    : idle_ns_(idle_ns),
      limits_{.first_pause_ns = config.first_back_off_ns, .max_pause_ns = config.max_back_off_ns, .attempts = 10},
      seeds_(seed) {
  for (const DroneName& drone : drones) slots_.push_back(Slot{.drone = drone});
}

void IdleEvictor::restart_count(TimeNs now, Slot& slot) {
  slot.idle_since_ns = now;
  slot.repeat.reset();
}

void IdleEvictor::update(TimeNs now, DroneNumber drone, const View& view) {
  Slot* slot = find_drone(slots_, drone);
  if (!slot) return;
  if (view.lease != slot->lease || !view.on_ground) restart_count(now, *slot);
  slot->lease = view.lease;
  slot->ledger_alive = view.ledger_alive;
  if (!view.ledger_alive) slot->idle_since_ns = std::max(slot->idle_since_ns, now - idle_ns_ + catch_up_ns);
}

void IdleEvictor::on_command(TimeNs now, DroneNumber drone) {
  if (Slot* slot = find_drone(slots_, drone)) restart_count(now, *slot);
}

std::optional<IdleEvictor::Sending> IdleEvictor::next(TimeNs now) {
  if (idle_ns_ == 0) return std::nullopt;
  const auto slot = std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) {
    return s.lease && s.ledger_alive && s.call == 0 && now - s.idle_since_ns >= idle_ns_ &&
           (!s.repeat || now >= s.next_ns);
  });
  if (slot == slots_.end()) return std::nullopt;
  if (!slot->repeat) slot->repeat.emplace(limits_, seeds_.next(), now);
  slot->call = ++last_call_;
  return Sending{slot->call, &slot->drone, *slot->lease};
}

std::optional<IdleEvictor::Ended> IdleEvictor::finished(TimeNs now, std::uint64_t number,
                                                        const fabric::Outcome& outcome) {
  const auto slot = std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) { return s.call == number; });
  if (slot == slots_.end() || number == 0) return std::nullopt;
  slot->call = 0;
  using Next = fabric::Repeat::Next;
  Ended ended{&slot->drone, std::nullopt};
  if (outcome.kind == fabric::Outcome::Kind::committed) {
    ended.next = Next::on_ledger;
  } else if (slot->repeat) {
    ended.next = slot->repeat->ended(now, outcome);
  }
  if (!ended.next) return ended;
  if (*ended.next == Next::again) {
    ++counters_.repeated;
    slot->next_ns = slot->repeat->at_ns();
    return ended;
  }
  ++(*ended.next == Next::on_ledger ? counters_.evicted
     : *ended.next == Next::refused ? counters_.refused
                                    : counters_.given_up);
  restart_count(now, *slot);
  return ended;
}

bool IdleEvictor::is_evicting(DroneNumber drone) const {
  const Slot* slot = find_drone(slots_, drone);
  return slot && slot->call != 0;
}

bool IdleEvictor::in_flight() const {
  return std::any_of(slots_.begin(), slots_.end(), [](const Slot& s) { return s.call != 0; });
}

fabric::Call encode_evict(const IdleEvictor::Sending& sending) {
  DronesCall call;
  call.add_drones(sending.drone->name);
  call.add_epochs(sending.lease);
  return {contract::evict, {call.SerializeAsString()}};
}

}  // namespace ledgerline::agent
