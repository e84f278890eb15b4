#include "hil/fault/schedule.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace ledgerline::hil {
namespace {

using What = Fault::What;

}  // namespace

Result<FaultSchedule> FaultSchedule::create(std::vector<Fault> faults, const std::vector<DroneFacts>& drones) {
  std::vector<Item> items;
  for (Fault& fault : faults) {
    Item item;
    for (std::size_t i = 0; i < drones.size(); ++i) {
      if (fault.drone.empty() || fault.drone == drones[i].name) item.drones.push_back(i);
    }
    if (item.drones.empty())
      return Error{fmt::format("\"{}\": no {} flies here, only {} to {}", fault.text, fault.drone, drones.front().name,
                               drones.back().name)};
    item.fault = std::move(fault);
    items.push_back(std::move(item));
  }
  return FaultSchedule(std::move(items));
}

void FaultSchedule::step(VirtualWorld& world) {
  const TimeNs now = world.now();
  bool changed = false;
  for (Item& item : items_) {
    const Fault& fault = item.fault;
    if (!item.reached_ns) {
      const bool reached = std::any_of(item.drones.begin(), item.drones.end(),
                                       [&](std::size_t i) { return fault.trigger.reached(now, world.facts()[i]); });
      if (!reached) continue;
      item.reached_ns = fault.trigger.kind == Trigger::Kind::time ? now - fault.trigger.after_ns : now;
    }
    if (!item.begun_ns && now >= *item.reached_ns + fault.trigger.after_ns) {
      item.begun_ns = now;
      begin(world, item);
      if (fault.momentary()) item.ended_ns = now;
      changed = true;
    }
    if (item.active() && fault.for_ns > 0 && now >= *item.begun_ns + fault.for_ns) {
      item.ended_ns = now;
      end(world, item);
      changed = true;
    }
  }
  if (changed) apply(world);
}

void FaultSchedule::begin(VirtualWorld& world, Item& item) {
  const Fault& fault = item.fault;
  world.note(WorldEvent::Kind::fault, item.drones[0], "begins: " + fault.text);
  for (const std::size_t i : item.drones) {
    const DroneNumber number = world.facts()[i].number;
    switch (fault.what) {
      case What::reboot:
        world.sim().restart(number);
        break;
      case What::battery:
        world.sim().set_battery(number, fault.value);
        break;
      case What::propeller:
        world.sim().lose_propeller(number);
        break;
      case What::kick:
        world.sim().kick(number, fault.vector);
        break;
      case What::stop_drone:
        world.say_stop(fault.stopper, i, fault.stop_word);
        break;
      default:
        break;
    }
  }
  switch (fault.what) {
    case What::ledger_restart:
      world.restart_ledger();
      break;
    case What::kill:
      world.kill(fault.ends[0]);
      break;
    case What::end:
      world.end_link();
      break;
    case What::clock_jump:
      world.jump_clock(fault.time_ns);
      break;
    default:
      break;
  }
}

void FaultSchedule::end(VirtualWorld& world, Item& item) {
  const Fault& fault = item.fault;
  world.note(WorldEvent::Kind::fault, item.drones[0], "ends: " + fault.text);
  if (fault.what != What::kill) return;
  // Of the same process another may go on.
  const bool goes_on = std::any_of(items_.begin(), items_.end(), [&](const Item& other) {
    return other.active() && other.fault.what == What::kill && other.fault.ends == fault.ends;
  });
  if (!goes_on) world.start(fault.ends[0]);
}

void FaultSchedule::apply(VirtualWorld& world) const {
  apply_processes(world);
  apply_wind(world);
  for (std::size_t drone = 0; drone < world.facts().size(); ++drone) {
    std::array<Impairment, line_count> lines;
    std::vector<SensorFault> sensors;
    MocapFault mocap;
    double drain_per_s = 0;
    for (std::size_t number = 0; number < items_.size(); ++number) {
      const Item& item = items_[number];
      const Fault& fault = item.fault;
      if (!item.active() || std::find(item.drones.begin(), item.drones.end(), drone) == item.drones.end()) continue;
      for (const LineAt at : fault.lines) overlay(fault.impairment, lines[static_cast<std::size_t>(at)]);
      if (fault.what == What::sensor) {
        sensors.push_back(fault.sensor);
        sensors.back().item = number;
      }
      if (fault.what == What::drain) drain_per_s += fault.value;
      if (fault.what == What::mocap_frozen) mocap.frozen = true;
      if (fault.what == What::mocap_noise) mocap.noise_m = fault.value;
      if (fault.what == What::mocap_every) mocap.period_ns = fault.time_ns;
      if (fault.what == What::mocap_offset) {
        for (std::size_t i = 0; i < 3; ++i) mocap.offset_m[i] += fault.vector[i];
      }
    }
    for (std::size_t i = 0; i < line_count; ++i) world.lines(drone).impair(static_cast<LineAt>(i), lines[i]);
    world.lines(drone).set_sensor_faults(std::move(sensors));
    world.lines(drone).set_mocap_fault(mocap);
    world.sim().drain_battery(world.facts()[drone].number, drain_per_s);
  }
}

// The ledger and its connections, and who stands still.
void FaultSchedule::apply_processes(VirtualWorld& world) const {
  const auto active = [&](What what, auto&& fits) {
    return std::any_of(items_.begin(), items_.end(),
                       [&](const Item& item) { return item.active() && item.fault.what == what && fits(item.fault); });
  };
  world.relay().lie(RelayLie::none);
  for (const Item& item : items_) {
    if (!item.active() || item.fault.what != What::relay) continue;
    world.relay().lie(item.fault.relay);
    world.relay().compared(item.fault.value > 0);
  }
  world.stall_ledger(active(What::ledger_stall, [](const Fault&) { return true; }));
  for (const Process process : {Process::agent, Process::link, Process::ground}) {
    const auto of_it = [&](const Fault& fault) {
      return std::find(fault.ends.begin(), fault.ends.end(), process) != fault.ends.end();
    };
    world.stop(process, active(What::stop, of_it));
    if (process == Process::link) continue;  // it has no connection
    LedgerPort& port = world.port(process);
    port.cut(world.now(), active(What::ledger_cut, of_it));
    port.stale(active(What::ledger_stale, of_it));
    port.lie(Lie::none);
    port.slip(Slip::none);
    for (const Item& item : items_) {
      if (!item.active() || !of_it(item.fault)) continue;
      if (item.fault.what == What::ledger_lie) port.lie(item.fault.lie);
      if (item.fault.what == What::slip) port.slip(item.fault.slip);
    }
    port.stall_to(active(What::ledger_hold, [&](const Fault& fault) { return of_it(fault) && fault.to; }));
    port.stall_from(active(What::ledger_hold, [&](const Fault& fault) { return of_it(fault) && fault.from; }));
    std::optional<Distribution> to, from;  // the later one in the script
    for (const Item& item : items_) {
      if (!item.active() || item.fault.what != What::ledger_delay || !of_it(item.fault)) continue;
      if (item.fault.to) to = item.fault.delay;
      if (item.fault.from) from = item.fault.delay;
    }
    port.delay_to(std::move(to));
    port.delay_from(std::move(from));
  }
}

// Winds add up.
void FaultSchedule::apply_wind(VirtualWorld& world) const {
  std::array<double, 3> wind{};
  for (const Item& item : items_) {
    if (!item.active() || item.fault.what != What::wind) continue;
    for (std::size_t i = 0; i < 3; ++i) wind[i] += item.fault.vector[i];
  }
  world.sim().set_wind(wind);
}

std::vector<std::string> FaultSchedule::never_begun() const {
  std::vector<std::string> texts;
  for (const Item& item : items_) {
    if (!item.begun_ns && !item.fault.optional) texts.push_back(never_text(item.fault));
  }
  return texts;
}

bool FaultSchedule::restart_pending() const {
  return std::any_of(items_.begin(), items_.end(), [](const Item& item) {
    return item.active() && item.fault.what == What::kill && item.fault.for_ns > 0;
  });
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
  return found == items_.end() ? std::span<const std::size_t>() : std::span<const std::size_t>(found->drones);
}

FaultSchedule::Effect FaultSchedule::effect_on(std::size_t drone, TimeNs now) const {
  Effect effect;
  for (const Item& item : items_) {
    const bool its = std::find(item.drones.begin(), item.drones.end(), drone) != item.drones.end();
    const bool for_good = item.fault.what == What::propeller || item.fault.what == What::end;
    const TimeNs after = item.fault.silences() ? restart_ns : aftermath_ns;
    if (!item.begun_ns || !its || (!for_good && item.ended_ns && now > *item.ended_ns + after)) continue;
    effect.pushed = effect.pushed || item.fault.pushes();
    effect.deafened = effect.deafened || item.fault.deafens() || item.fault.silences();
  }
  return effect;
}

}  // namespace ledgerline::hil
