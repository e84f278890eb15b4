#include "ground/core/lease/pilot_stops.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "common/access/access.hpp"
#include "common/access/stops.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::ground {
namespace {

/// A stop that did not reach the ledger by then is given up, aloud: drone and ground have landed it long since.
constexpr TimeNs stop_within_ns = 30 * ns_per_s;

}  // namespace

PilotStops::PilotStops(const std::vector<FlightDrone>& drones, const crypto::IdentityName& self)
    : drones_(drones), self_(self) {}

PilotStops::Slot& PilotStops::slot_of(std::size_t drone, const std::optional<crypto::IdentityName>& by) {
  auto found = std::ranges::find_if(slots_, [&](const Slot& s) { return s.drone == drone && s.by == by; });
  if (found == slots_.end()) {
    // Pilots that stop at one time do not come back together.
    const crypto::IdentityName& who = by ? *by : self_;
    const std::uint64_t seed = std::hash<std::string>{}(who.msp_id + who.subject) + drone;
    found = slots_.insert(found, {.drone = drone, .by = by, .seed = seed});
  }
  return *found;
}

void PilotStops::request(TimeNs now, std::size_t drone, bool cut, const std::optional<crypto::IdentityName>& by) {
  Slot& slot = slot_of(drone, by);
  if (slot.stop && !slot.clears && (!cut || slot.stop->cut())) return;
  if (slot.stop && slot.clears && slot.id != 0) slot.overtaken_id = slot.id;
  slot.clears = false;
  slot.cut = cut;
  slot.stop.emplace();
  slot.stop->add_drones(drones_[drone].name);
  slot.stop->set_cut(cut);
  slot.counted = true;
  slot.repeat.emplace(fabric::RepeatLimits{.within_ns = stop_within_ns}, slot.seed, now);
  slot.id = 0;  // what may be in flight asks for less
  slot.next_ns = now;
}

Status PilotStops::request_clear(TimeNs now, std::size_t drone) {
  Slot& slot = slot_of(drone, std::nullopt);
  if (slot.stop && slot.clears) return done;
  if (slot.stop) return Error{"its stop is not cleared: a stop of it is on its way to the ledger"};
  slot.clears = true;
  slot.stop.emplace();
  slot.stop->add_drones(drones_[drone].name);
  slot.repeat.emplace(fabric::RepeatLimits{.within_ns = stop_within_ns}, slot.seed, now);
  slot.id = 0;
  slot.next_ns = now;
  return done;
}

void PilotStops::submit(TimeNs now, const LeaseBook& leases, std::uint64_t& next_id,
                        std::vector<Submission>& submissions) {
  for (Slot& slot : slots_) {
    if (!slot.stop || slot.id != 0 || now < slot.next_ns) continue;
    if (slot.clears) {
      const Control& stoppers = leases.of(slot.drone).stoppers;
      if (stoppers.stoppers_size() != 1 || !is_stopped_by(stoppers, to_message(self_))) {
        slot.stop.reset();
        continue;
      }
    }
    slot.stop->clear_clears();
    const std::optional<Control>& record = leases.of(slot.drone).record;
    if (slot.counted && record && !slot.clears)
      slot.stop->add_clears(clears_of(*record, to_message(slot.by ? *slot.by : self_)));
    slot.id = next_id++;
    submissions.push_back({slot.id,
                           {slot.clears ? contract::clear_stop : contract::stop, {slot.stop->SerializeAsString()}},
                           true,
                           slot.by});
  }
}

std::optional<PilotStops::Ended> PilotStops::on_outcome(TimeNs now, const fabric::Outcome& outcome, std::uint64_t id) {
  const auto overtaken = std::ranges::find_if(slots_, [&](const Slot& s) { return s.overtaken_id == id; });
  if (overtaken != slots_.end()) {
    overtaken->overtaken_id = 0;
    // Committed, or nobody knows: it may have cleared the stop that was asked for behind it.
    if (!outcome.refusal) {
      overtaken->stop.reset();
      request(now, overtaken->drone, overtaken->cut, overtaken->by);
    }
    return Ended{overtaken->drone, ""};
  }
  const auto slot = std::ranges::find_if(slots_, [&](const Slot& s) { return s.id == id; });
  if (slot == slots_.end()) return std::nullopt;
  slot->id = 0;
  using Next = fabric::Repeat::Next;
  const Next next = slot->repeat->ended(now, outcome);
  slot->next_ns = slot->repeat->at_ns();
  Ended ended{slot->drone, ""};
  if (next == Next::again) return ended;
  if (next == Next::refused && !slot->stop->clears().empty()) {
    slot->counted = false;
    slot->next_ns = now;
    return ended;
  }
  slot->stop.reset();
  const char* const what = slot->clears ? "its stop is not cleared" : "no stop";
  if (next == Next::refused) ended.problem = fmt::format("{}: {}", what, outcome.refusal->words);
  if (next == Next::given_up)
    ended.problem =
        fmt::format("{}: not on the ledger within {:.0f} s: {}", what, to_seconds(stop_within_ns), outcome.message);
  return ended;
}

bool PilotStops::pending() const {
  return std::ranges::any_of(slots_, [](const Slot& slot) { return slot.stop.has_value(); });
}

bool PilotStops::pending(std::size_t drone) const {
  return std::ranges::any_of(
      slots_, [&](const Slot& slot) { return slot.drone == drone && slot.stop.has_value() && !slot.clears; });
}

}  // namespace ledgerline::ground
