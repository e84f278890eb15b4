#include "onboard/agent/core/outbox/batcher.hpp"

#include <algorithm>

#include "common/base/check.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::agent {
namespace {

/// A drone that has sent nothing for longer is not waited for. Three periods of the slowest usual rate, 10 Hz.
constexpr TimeNs recent_ns = 300 * ns_per_ms;

/// Of a drone's states each so-many-th brings its charge. `get` finds what the last batch has not in the batches before
/// it, of which some may be other drones'.
constexpr std::size_t battery_every = 16;
static_assert(4 * battery_every <= contract::max_page_versions);
// Who begins to read in the middle of a slow ledger's batches knows the charge soon, too.
constexpr TimeNs max_battery_gap_ns = 1 * ns_per_s;

bool newer(const StateSample& a, const StateSample& b) { return a.boot_id != b.boot_id || a.sequence > b.sequence; }

}  // namespace

Batcher::Batcher(const BatchSettings& settings, const std::vector<DroneName>& drones, std::uint64_t seed)
    : settings_(settings), random_(seed), pause_(settings.back_off) {
  for (const DroneName& drone : drones) slots_.push_back(Slot{.drone = drone});
}

Batcher::Counters Batcher::counters(DroneNumber drone) const {
  const Slot* slot = find_drone(slots_, drone);
  return slot ? slot->counters : Counters{};
}

void Batcher::add(TimeNs now, const StateSample& sample) {
  Slot* slot = find_drone(slots_, sample.drone);
  if (!slot) return;
  ++slot->counters.sampled;
  slot->newest_ns = now;
  if (slot->waiting && !newer(sample, *slot->waiting)) {
    ++slot->counters.merged;
    return;
  }
  if (!has_waiting()) first_waiting_ns_ = now;
  if (slot->waiting) {
    ++slot->counters.merged;
  } else {
    ++slot->counters.pending;
  }
  slot->waiting = sample;
}

bool Batcher::has_waiting() const {
  return std::any_of(slots_.begin(), slots_.end(), [](const Slot& s) { return s.waiting.has_value(); });
}

TimeNs Batcher::due_ns(TimeNs now) const {
  TimeNs first_ns = INT64_MAX;  // of a sample that is not held back by its drone's pause
  bool all = true;
  for (const Slot& slot : slots_) {
    if (slot.waiting) first_ns = std::min(first_ns, slot.paused_until_ns);
    if (slot.paused_until_ns > now) continue;
    all = all && (slot.waiting.has_value() || now - slot.newest_ns > recent_ns);
  }
  if (first_ns == INT64_MAX || in_flight_.full()) return INT64_MAX;
  first_ns = std::max(first_ns, pause_.until_ns());
  if (again_at_once_) return first_ns;
  first_ns = std::max({first_ns, in_flight_.next_ns(), in_flight_.last_ns() + settings_.min_gap_ns});
  return all ? first_ns : std::max(first_ns, first_waiting_ns_ + settings_.linger_ns);
}

void Batcher::drop_stale(TimeNs now) {
  for (Slot& slot : slots_) {
    if (!slot.waiting || now - slot.waiting->stamp_ns <= settings_.freshness_ns) continue;
    slot.waiting.reset();
    --slot.counters.pending;
    ++slot.counters.dropped;
    ++slot.counters.stale;
  }
}

bool Batcher::take_battery_turn(TimeNs now, Slot& slot) {
  const bool due = slot.states_to_battery == 0 || slot.waiting->battery != slot.battery ||
                   now - slot.battery_ns >= max_battery_gap_ns;
  if (due) slot.battery_ns = now;
  slot.battery = slot.waiting->battery;
  slot.states_to_battery = due ? battery_every - 1 : slot.states_to_battery - 1;
  return due;
}

std::optional<StateBatch> Batcher::next(TimeNs now) {
  drop_stale(now);
  if (now < due_ns(now)) return std::nullopt;
  again_at_once_ = false;
  StateBatch batch{.number = ++last_number_, .submitted_ns = now, .samples = {}, .repeated = {}, .batteries = {}};
  for (Slot& slot : slots_) {
    if (slot.paused_until_ns > now) continue;
    if (!slot.waiting) {
      if (slot.sent) batch.repeated.push_back(*slot.sent);
      continue;
    }
    if (!slot.sent || newer(*slot.waiting, *slot.sent)) ++slot.counters.sent;
    slot.sent = slot.waiting;
    if (take_battery_turn(now, slot)) batch.batteries.push_back(slot.drone.number);
    batch.samples.push_back(*slot.waiting);
    slot.waiting.reset();
  }
  in_flight_.add(batch.number, now, batch);
  return batch;
}

void Batcher::drop_all(const StateBatch& batch) {
  for (const StateSample& sample : batch.samples) {
    Slot* slot = find_drone(slots_, sample.drone);
    --slot->counters.pending;
    ++slot->counters.dropped;
  }
}

Batcher::Slot* Batcher::refused_drone(const StateBatch& batch, const fabric::Outcome& outcome) {
  if (!outcome.refusal) return nullptr;
  const auto names_it = [&](const StateSample& s) {
    return fabric::names(*outcome.refusal, find_drone(slots_, s.drone)->drone.name);
  };
  for (const auto* samples : {&batch.samples, &batch.repeated}) {
    const auto it = std::find_if(samples->begin(), samples->end(), names_it);
    if (it != samples->end()) return find_drone(slots_, it->drone);
  }
  return nullptr;
}

void Batcher::send_again_without(TimeNs now, Slot& refused, const StateBatch& batch) {
  refused.paused_until_ns = now + settings_.refused_drone_pause_ns;
  for (const StateSample& sample : batch.samples) {
    Slot* slot = find_drone(slots_, sample.drone);
    if (slot == &refused) {
      --slot->counters.pending;
      ++slot->counters.dropped;
    } else if (slot->waiting || newer(*slot->sent, sample)) {  // a newer one waits, or is on its way
      --slot->counters.pending;
      ++slot->counters.merged;
    } else {
      slot->waiting = sample;
    }
  }
  again_at_once_ = true;
}

std::optional<StateBatch> Batcher::finished(TimeNs now, std::uint64_t number, const fabric::Outcome& outcome) {
  auto ended = in_flight_.end(number, outcome);
  if (!ended) return std::nullopt;
  const StateBatch& batch = ended->what;
  if (outcome.kind != fabric::Outcome::Kind::committed) {
    for (const DroneNumber drone : batch.batteries) find_drone(slots_, drone)->states_to_battery = 0;
  }
  using Kind = fabric::Outcome::Kind;
  switch (outcome.kind) {
    case Kind::committed:
      ++transactions_.committed;
      pause_.succeeded();
      for (const StateSample& sample : batch.samples) {
        Slot* slot = find_drone(slots_, sample.drone);
        --slot->counters.pending;
        ++slot->counters.on_ledger;
      }
      break;
    case Kind::invalidated:
      ++transactions_.invalidated;
      pause_.succeeded();
      drop_all(batch);
      break;
    case Kind::refused:
      ++transactions_.refused;
      if (Slot* slot = refused_drone(batch, outcome)) {
        send_again_without(now, *slot, batch);
      } else {
        drop_all(batch);
        pause_.failed(now, random_);
      }
      break;
    case Kind::unavailable:
    case Kind::overloaded:
      ++transactions_.unavailable;
      drop_all(batch);
      pause_.failed(now, random_);
      break;
  }
  for (const Slot& slot : slots_) {
    const Counters& c = slot.counters;
    LEDGERLINE_CHECK(c.sampled == c.on_ledger + c.merged + c.dropped + c.pending, "each sample has one end",
                     slot.drone.name, c.sampled, c.pending);
  }
  return std::move(ended->what);
}

}  // namespace ledgerline::agent
