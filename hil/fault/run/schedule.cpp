#include "hil/fault/run/schedule.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace ledgerline::hil {

Result<FaultSchedule> FaultSchedule::create(std::vector<Fault> faults, const std::vector<DroneObservation>& drones) {
  std::vector<Item> items;
  for (Fault& fault : faults) {
    TriggerWatch watch(fault.trigger, fault.drone, drones);
    if (watch.drones.empty())
      return Error{fmt::format("\"{}\": no {} flies here, only {}{}", fault.text, fault.drone, drones.front().name,
                               drones.size() > 1 ? " to " + drones.back().name : "")};
    if (fault.acts.of_two_drones && drones.size() < 2)
      return Error{
          fmt::format("\"{}\": {} flies alone; it needs another drone in the flight", fault.text, drones.front().name)};
    items.push_back({std::move(fault), std::move(watch)});
  }
  return FaultSchedule(std::move(items), drones.size());
}

void FaultSchedule::step(SimulatedWorld& world) {
  const TimeNs now = world.now();
  bool changed = false;
  for (Item& item : items_) {
    const Fault& fault = item.fault;
    if (!item.begun_ns && item.watch.is_due(now, world.drones())) {
      item.begun_ns = now;
      begin(world, item);
      if (fault.acts.momentary) item.ended_ns = now;
      changed = true;
    }
    if (item.active() && fault.for_ns > 0 && now >= *item.begun_ns + fault.for_ns) {
      item.ended_ns = now;
      end(world, item);
      changed = true;
    }
  }
  if (changed) effects().apply_to(world);
}

void FaultSchedule::begin(SimulatedWorld& world, const Item& item) const {
  const FaultActs& acts = item.fault.acts;
  world.note(WorldEvent::Kind::fault, item.watch.drones[0], "begins: " + item.fault.text);
  for (const std::size_t drone : item.watch.drones) {
    if (acts.strike) acts.strike(world, drone);
  }
  if (acts.begin) acts.begin(world);
}

void FaultSchedule::end(SimulatedWorld& world, const Item& item) const {
  world.note(WorldEvent::Kind::fault, item.watch.drones[0], "ends: " + item.fault.text);
  const bool goes_on = std::any_of(items_.begin(), items_.end(), [&](const Item& other) {
    return other.active() && other.fault.text == item.fault.text;
  });
  if (item.fault.acts.end && !goes_on) item.fault.acts.end(world);
}

Effects FaultSchedule::effects() const {
  Effects effects(drone_count_);
  for (std::size_t number = 0; number < items_.size(); ++number) {
    const Item& item = items_[number];
    if (!item.active()) continue;
    if (item.fault.acts.lasts) item.fault.acts.lasts(effects);
    for (const std::size_t drone : item.watch.drones) {
      if (item.fault.acts.lasts_on) item.fault.acts.lasts_on(effects.drones[drone], number);
    }
  }
  return effects;
}

std::vector<std::string> FaultSchedule::never_begun() const {
  std::vector<std::string> texts;
  for (const Item& item : items_) {
    if (!item.begun_ns && !item.fault.optional) texts.push_back(never_text(item.fault));
  }
  return texts;
}

bool FaultSchedule::restart_pending() const {
  return std::any_of(items_.begin(), items_.end(),
                     [](const Item& item) { return item.active() && item.fault.acts.end && item.fault.for_ns > 0; });
}

bool FaultSchedule::any_active() const {
  return std::any_of(items_.begin(), items_.end(), [](const Item& item) { return item.active(); });
}

std::optional<TimeNs> FaultSchedule::first_begun_ns() const {
  std::optional<TimeNs> first;
  for (const Item& item : items_) {
    if (item.begun_ns && (!first || *item.begun_ns < *first)) first = item.begun_ns;
  }
  return first;
}

std::optional<TimeNs> FaultSchedule::last_ended_ns() const {
  std::optional<TimeNs> last;
  for (const Item& item : items_) {
    if (!item.ended_ns) return std::nullopt;
    if (!last || *item.ended_ns > *last) last = item.ended_ns;
  }
  return last;
}

std::span<const std::size_t> FaultSchedule::first_drones() const {
  const auto first = first_begun_ns();
  const auto found =
      std::find_if(items_.begin(), items_.end(), [&](const Item& item) { return first && item.begun_ns == first; });
  return found == items_.end() ? std::span<const std::size_t>() : std::span<const std::size_t>(found->watch.drones);
}

Moment::Excuse FaultSchedule::excuse_of(std::size_t drone, TimeNs now) const {
  Moment::Excuse excuse;
  for (const Item& item : items_) {
    const bool its = std::find(item.watch.drones.begin(), item.watch.drones.end(), drone) != item.watch.drones.end();
    const FaultActs& acts = item.fault.acts;
    excuse.cut = excuse.cut || (item.begun_ns && its && acts.cuts);
    const TimeNs after = acts.stops_link ? restart_ns : aftermath_ns;
    if (!item.begun_ns || !its || (!acts.for_good && item.ended_ns && now > *item.ended_ns + after)) continue;
    excuse.physical = excuse.physical || acts.pushes;
    excuse.blind = excuse.blind || acts.blinds;
    excuse.misled = excuse.misled || acts.misleads_mps > 0;
    excuse.deaf = excuse.deaf || acts.deafens || acts.stops_link;
    excuse.broken = excuse.spins = excuse.broken || acts.breaks;
  }
  return excuse;
}

}  // namespace ledgerline::hil
