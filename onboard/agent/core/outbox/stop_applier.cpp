#include "onboard/agent/core/outbox/stop_applier.hpp"

#include <algorithm>
#include <limits>

#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::agent {

StopApplier::StopApplier(const BatchConfig& config, const std::vector<DroneName>& drones, std::uint64_t seed)
    : limits_{.first_pause_ns = config.first_back_off_ns,
              .max_pause_ns = config.max_back_off_ns,
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

}  // namespace ledgerline::agent
