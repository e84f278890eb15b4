// Faults of the drones themselves, of their network, sensors and air.
#include <cmath>
#include <numbers>

#include "hil/fault/kinds/parse.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/sitl/observation.hpp"

namespace ledgerline::hil {
namespace {

using ParsedText = FaultKind::ParsedText;

/// Once, at its beginning, to each drone that it names.
template <typename Act>
FaultActs at_once(Act act, bool pushes = false) {
  return {.strike = [act](SimulatedWorld& world, std::size_t drone) { act(world.sim(), world.drones()[drone].number); },
          .check_real = because(inside_the_simulation),
          .momentary = true,
          .pushes = pushes};
}

/// Effects of a drone's traffic while it goes on.
auto overlay_on(std::vector<DroneTraffic> traffic, const Impairment& effects) {
  return [traffic = std::move(traffic), effects](Effects::OfDrone& drone, std::size_t) {
    for (const DroneTraffic at : traffic) overlay(effects, drone.impairment(at));
  };
}

Result<FaultActs> link_effects(const ParsedText& parsed) {
  const std::string_view way = parsed.words[0];
  const auto effects = effects_in(parsed.rest);
  if (!effects) return effects.error();
  std::vector<DroneTraffic> traffic;
  if (way == "to" || way == "both") traffic.push_back(DroneTraffic::to);
  if (way == "answers" || way == "from" || way == "both") traffic.push_back(DroneTraffic::answers);
  if (way == "states" || way == "from" || way == "both") traffic.push_back(DroneTraffic::states);
  return FaultActs{.lasts_on = overlay_on(traffic, *effects), .deafens = traffic.front() == DroneTraffic::to};
}

Result<FaultActs> plan_effects(const ParsedText& parsed) {
  const auto effects = effects_in(parsed.rest);
  if (!effects) return effects.error();
  const std::string_view none = effects->corrupt > 0    ? "corrupt"
                                : effects->truncate > 0 ? "truncate"
                                : effects->rate         ? "rate"
                                                        : "";
  if (!none.empty()) return Error{"agent hands plans on in shared memory, which has no " + std::string(none)};
  return FaultActs{.lasts_on = overlay_on({DroneTraffic::plans}, *effects),
                   .check_real = because("plans go from agent to link in shared memory")};
}

Result<FaultActs> reboot(const ParsedText&) {
  return at_once([](sim::Simulator& sim, DroneNumber drone) { sim.restart(drone); }, true);
}

Result<FaultActs> remove_propeller(const ParsedText&) {
  FaultActs acts = at_once([](sim::Simulator& sim, DroneNumber drone) { sim.remove_propeller(drone); }, true);
  acts.breaks = acts.for_good = true;
  return acts;
}

Result<FaultActs> set_battery(const ParsedText& parsed) {
  const auto share = parse_share(parsed.words[0]);
  if (!share) return Error{"battery must be followed by a share, 0% to 100%"};
  return at_once([share = *share](sim::Simulator& sim, DroneNumber drone) { sim.set_battery(drone, share); });
}

Result<FaultActs> heat(const ParsedText& parsed) {
  constexpr double max_c = 150;
  const auto celsius = parse_number(parsed.words[0]);
  if (!celsius || *celsius < 0 || *celsius > max_c) return Error{"heat must be followed by 0 to 150 degrees Celsius"};
  return at_once([celsius = *celsius](sim::Simulator& sim, DroneNumber drone) { sim.set_temperature(drone, celsius); });
}

Result<FaultActs> drain(const ParsedText& parsed) {
  const auto share = parse_share(parsed.words[0]);
  if (!share) return Error{"drain must be followed by a share a second, 0% to 100%"};
  return FaultActs{.lasts_on = [share = *share](Effects::OfDrone& drone, std::size_t) { drone.drain_per_s += share; },
                   .check_real = because(inside_the_simulation)};
}

Result<FaultActs> kick(const ParsedText& parsed) {
  const auto velocity = vector_of(parsed.words);
  if (!velocity) return Error{"kick must be followed by three velocities in m/s"};
  return at_once([velocity = *velocity](sim::Simulator& sim, DroneNumber drone) { sim.kick(drone, velocity); }, true);
}

// Winds add up.
Result<FaultActs> wind(const ParsedText& parsed) {
  const auto velocity = vector_of(parsed.words);
  if (!velocity) return Error{"wind must be followed by three velocities in m/s"};
  return FaultActs{.lasts =
                       [velocity = *velocity](Effects& effects) {
                         for (std::size_t i = 0; i < 3; ++i) effects.wind_mps[i] += velocity[i];
                       },
                   .check_real = because(inside_the_simulation),
                   .pushes = true};
}

/// One more fault of a drone's state texts or answers, which the proxy or the shim knows by the same words.
template <typename Fault>
FaultActs switched(std::vector<Fault> Effects::OfDrone::*faults, const Fault& fault, const std::string& text) {
  return {.lasts_on =
              [faults, fault](Effects::OfDrone& drone, std::size_t item) {
                (drone.*faults).push_back(fault);
                (drone.*faults).back().item = item;
              },
          .really_begin = [text](RealActs& real, const RealStack&) { real.proxy.push_back(text); },
          .really_end = [text](RealActs& real, const RealStack&, bool) { real.proxy.push_back(text + " off"); }};
}

Result<FaultActs> sensor(const ParsedText& parsed) {
  const auto fault = parse_sensor(parsed.rest);
  if (!fault) return fault.error();
  FaultActs acts = switched(&Effects::OfDrone::sensors, *fault, parsed.text);
  // A text that says the wrong velocity or heading, up to the other way round: all but the battery's.
  acts.misleads_mps = fault->field == "bat" ? 0 : 2 * rc_full_mps;
  return acts;
}

Result<FaultActs> sdk(const ParsedText& parsed) {
  const auto fault = parse_sdk_fault(std::string(parsed.words[0]) + " " + parsed.rest);
  if (!fault) return fault.error();
  FaultActs acts = switched(&Effects::OfDrone::sdk, *fault, parsed.text);
  acts.check_real = [](const Fault&, const RealStack& stack) -> Status {
    return allow_if(stack.shim,
                    "the proxy knows datagrams, not the SDK's calls: simulated time has it, and the shim "
                    "(--shim, docs/faults.md)");
  };
  // As a state text that says another velocity or heading, up to the other way round.
  acts.misleads_mps = of_states(fault->kind) ? 2 * rc_full_mps : 0;
  acts.of_two_drones = fault->kind == SdkFault::Kind::other_drone;
  return acts;
}

// What link does not fly by.
Status with_mocap(const WorldConfig& flight) {
  const bool has = flight.pose == link::PoseSource::mocap || flight.pose == link::PoseSource::mocap_then_tello;
  return allow_if(has, "this flight has no motion capture (flight.pose)");
}

template <typename Set>
FaultActs of_mocap(Set set, double misleads_m = 0) {
  return {.lasts_on = [set](Effects::OfDrone& drone, std::size_t) { set(drone.mocap); },
          .check_real = because(inside_the_simulation),
          .check_flight = with_mocap,
          .misleads_m = misleads_m};
}

void add(std::array<double, 3>& to, const std::array<double, 3>& more) {
  for (std::size_t i = 0; i < 3; ++i) to[i] += more[i];
}

Result<FaultActs> mocap_frozen(const ParsedText&) {
  return of_mocap([](MocapFault& mocap) { mocap.frozen = true; });
}

Result<FaultActs> mocap_jump(const ParsedText& parsed) {
  const auto offset = vector_of(parsed.words);
  if (!offset) return Error{"jump must be followed by three distances in m"};
  return of_mocap([metres = *offset](MocapFault& mocap) { add(mocap.offset_m, metres); }, length_of(*offset));
}

constexpr double max_creep_mps = 5;
constexpr double crept_m = 0.6;  // until link sees that its sources differ, and stops

Result<FaultActs> mocap_creep(const ParsedText& parsed) {
  const auto velocity = vector_of(parsed.words);
  const double speed = velocity ? length_of(*velocity) : 0;
  if (speed <= 0 || speed > max_creep_mps) return Error{"creep must be followed by three velocities, up to 5 m/s"};
  return of_mocap([mps = *velocity](MocapFault& mocap) { add(mocap.creep_mps, mps); }, crept_m);
}

// How far a drone can fly the wrong way until link sees that it does not move as commanded.
constexpr double turned_m = 2;

Result<FaultActs> mocap_turn(const ParsedText& parsed) {
  const auto degrees = parse_number(parsed.words[0]);
  if (!degrees || std::abs(*degrees) > 180) return Error{"turn must be followed by -180 to 180 degrees"};
  return of_mocap([turn_rad = *degrees * std::numbers::pi / 180](MocapFault& mocap) { mocap.turn_rad += turn_rad; },
                  turned_m);
}

Result<FaultActs> mocap_noise(const ParsedText& parsed) {
  const auto sigma = parse_number(parsed.words[0]);
  if (!sigma || *sigma < 0 || *sigma > 100) return Error{"noise must be followed by 0 to 100 m"};
  return of_mocap([metres = *sigma](MocapFault& mocap) { mocap.noise_m = metres; }, 3 * *sigma);
}

Result<FaultActs> mocap_every(const ParsedText& parsed) {
  const auto period = parse_time(parsed.words[0]);
  if (!period) return period.error();
  if (*period <= 0) return Error{"every must be followed by more than 0 s"};
  return of_mocap([period = *period](MocapFault& mocap) { mocap.period_ns = period; });
}

Result<FaultActs> mocap_effects(const ParsedText& parsed) {
  const auto effects = effects_in(parsed.rest);
  if (!effects) return effects.error();
  return FaultActs{.lasts_on = overlay_on({DroneTraffic::mocap}, *effects),
                   .check_real = because("mocap goes past the proxy, by DDS"),
                   .check_flight = with_mocap};
}

constexpr FaultKind drone_table[] = {
    {"drone NAME to|answers|states|from|both EFFECTS...", link_effects},
    {"drone NAME plans EFFECTS...", plan_effects},
    {"drone NAME reboot", reboot},
    {"drone NAME propeller", remove_propeller},
    {"drone NAME battery SHARE", set_battery},
    {"drone NAME drain SHARE", drain},
    {"drone NAME heat CELSIUS", heat},
    {"drone NAME kick X Y Z", kick},
    {"sensor NAME FIELD...", sensor},
    {"mocap NAME frozen", mocap_frozen},
    {"mocap NAME jump X Y Z", mocap_jump},
    {"mocap NAME creep X Y Z", mocap_creep},
    {"mocap NAME turn DEGREES", mocap_turn},
    {"mocap NAME noise METRES", mocap_noise},
    {"mocap NAME every TIME", mocap_every},
    // EFFECTS are impairments of the traffic: delays, losses and so on.
    {"mocap NAME EFFECTS...", mocap_effects},
    {"wind X Y Z", wind},
    {"sdk NAME answers|states WHAT...", sdk},
};

}  // namespace

std::span<const FaultKind> drone_faults() { return drone_table; }

}  // namespace ledgerline::hil
