#include "hil/fault/kinds/effects.hpp"

#include <cassert>

#include "hil/netem/sdk/sdk_faults.hpp"

namespace ledgerline::hil {
namespace {

void set_port(LedgerPort& port, TimeNs now, const Effects::OfPort& effects) {
  port.cut(now, effects.cut);
  port.stale(effects.stale);
  port.lie(effects.lie);
  port.serve(effects.serves);
  port.order(effects.orders);
  port.slip(effects.slip);
  port.stall_to(effects.stall_to);
  port.stall_from(effects.stall_from);
  port.delay_to(effects.delay_to);
  port.delay_from(effects.delay_from);
}

}  // namespace

void Effects::apply_to(SimulatedWorld& world) const {
  world.relay().lie(relay ? relay->lie : RelayTampering::none);
  if (relay) world.relay().compared(relay->compared);
  world.stall_ledger(ledger_stalled);
  for (const Process process : {Process::agent, Process::link, Process::ground}) {
    world.stop(process, stopped[static_cast<std::size_t>(process)]);
    if (process != Process::link) set_port(world.port(process), world.now(), port(process));
  }
  world.sim().set_wind(wind_mps);
  for (const auto host : {SimulatedWorld::Host::mocap, SimulatedWorld::Host::drones})
    world.drift_clock(host, clock_drift[static_cast<std::size_t>(host)]);
  for (std::size_t i = 0; i < drones.size(); ++i) {
    for (std::size_t at = 0; at < drone_traffic_count; ++at)
      world.network(i).impair(static_cast<DroneTraffic>(at), drones[i].impairments[at]);
    [[maybe_unused]] const Status set = world.sdk().set(i, drones[i].sdk);
    assert(set.ok());  // a fault that needs another drone was refused where there is none
    world.network(i).set_sensor_faults(drones[i].sensors);
    world.network(i).set_mocap_fault(drones[i].mocap);
    world.sim().drain_battery(world.facts()[i].number, drones[i].drain_per_s);
    world.sim().set_sensing(world.facts()[i].number, drones[i].sensing);
  }
}

}  // namespace ledgerline::hil
