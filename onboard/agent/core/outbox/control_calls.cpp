#include "onboard/agent/core/outbox/control_calls.hpp"

#include <algorithm>
#include <limits>

#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::agent {

StopApplier::StopApplier(const BackOffLimits& back_off, const std::vector<DroneName>& drones, std::uint64_t seed)
    : limits_{.first_pause_ns = back_off.first_ns,
              .max_pause_ns = back_off.max_ns,
              .within_ns = std::numeric_limits<TimeNs>::max(),  // a stop stands until somebody clears it
              .attempts = std::numeric_limits<int>::max()},
      seeds_(seed) {
  for (const DroneName& drone : drones) slots_.push_back(Slot{.drone = drone});
}

void StopApplier::begin(TimeNs now, Slot& slot) {
  slot.repeat.emplace(limits_, seeds_.next(), now);
  slot.next_ns = now;
  slot.again = false;
}

void StopApplier::request(TimeNs now, DroneNumber drone) {
  Slot* slot = find_drone(slots_, drone);
  if (!slot) return;
  if (slot->call != 0) {
    slot->again = true;
  } else if (!slot->repeat) {
    begin(now, *slot);
  }
}

void StopApplier::request_renewal(TimeNs now) {
  if (!renewal_pause_.over(now)) return;
  renewal_pause_.failed(now, seeds_);
  for (const Slot& slot : slots_) request(now, slot.drone.number);
}

std::optional<StopApplier::Sending> StopApplier::next(TimeNs now) {
  const auto slot = std::find_if(slots_.begin(), slots_.end(),
                                 [&](const Slot& s) { return s.repeat && s.call == 0 && now >= s.next_ns; });
  if (slot == slots_.end()) return std::nullopt;
  slot->call = ++last_call_;
  return Sending{slot->call, &slot->drone};
}

bool StopApplier::finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome) {
  const auto slot = std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) { return s.call == number; });
  if (slot == slots_.end() || number == 0) return false;
  slot->call = 0;
  using Next = fabric::Repeat::Next;
  const Next next = slot->repeat->ended(now, outcome);
  if (next == Next::again) {
    ++repeated_;
    slot->next_ns = slot->repeat->at_ns();
    slot->again = false;  // what goes out next knows of it
    return true;
  }
  if (next == Next::on_ledger) ++applied_;
  slot->repeat.reset();
  if (slot->again) begin(now, *slot);
  return true;
}

bool StopApplier::pending() const {
  return std::any_of(slots_.begin(), slots_.end(), [](const Slot& s) { return s.repeat.has_value(); });
}

fabric::Call encode_apply_stops(const StopApplier::Sending& sending) {
  DronesCall call;
  call.add_drones(sending.drone->name);
  return {contract::apply_stops, {call.SerializeAsString()}};
}

IdleEvictor::IdleEvictor(TimeNs idle_ns, const BackOffLimits& back_off, const std::vector<DroneName>& drones,
                         std::uint64_t seed)
    : idle_ns_(idle_ns),
      limits_{.first_pause_ns = back_off.first_ns, .max_pause_ns = back_off.max_ns, .attempts = 10},
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

bool IdleEvictor::has_call_in_flight() const {
  return std::any_of(slots_.begin(), slots_.end(), [](const Slot& s) { return s.call != 0; });
}

fabric::Call encode_evict(const IdleEvictor::Sending& sending) {
  DronesCall call;
  call.add_drones(sending.drone->name);
  call.add_epochs(sending.lease);
  return {contract::evict, {call.SerializeAsString()}};
}

}  // namespace ledgerline::agent
