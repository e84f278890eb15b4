// Faults of the drones themselves, of their network, sensors and air.
#include <cmath>
#include <numbers>

#include "hil/fault/kinds/parse.hpp"
#include "hil/sitl/facts.hpp"

namespace ledgerline::hil {
namespace {

using ParsedWords = FaultKind::ParsedWords;

DroneNumber number_of(SimulatedWorld& world, std::size_t drone) { return world.facts()[drone].number; }

Result<FaultActs> link_effects(const ParsedWords& said) {
  const std::string_view way = said.words[0];
  const auto effects = effects_in(said.rest);
  if (!effects) return effects.error();
  std::vector<DroneTraffic> traffic;
  if (way == "to" || way == "both") traffic.push_back(DroneTraffic::to);
  if (way == "answers" || way == "from" || way == "both") traffic.push_back(DroneTraffic::answers);
  if (way == "states" || way == "from" || way == "both") traffic.push_back(DroneTraffic::states);
  return FaultActs{.lasts_on =
                       [traffic, effects = *effects](Effects::OfDrone& drone, std::size_t) {
                         for (const DroneTraffic at : traffic) overlay(effects, drone.impairment(at));
                       },
                   .deafens = traffic.front() == DroneTraffic::to};
}

Result<FaultActs> plan_effects(const ParsedWords& said) {
  const auto effects = effects_in(said.rest);
  if (!effects) return effects.error();
  const std::string_view none = effects->corrupt > 0    ? "corrupt"
                                : effects->truncate > 0 ? "truncate"
                                : effects->rate         ? "rate"
                                                        : "";
  if (!none.empty()) return Error{"agent hands plans on in shared memory, which has no " + std::string(none)};
  return FaultActs{
      .lasts_on = [effects = *effects](Effects::OfDrone& drone,
                                       std::size_t) { overlay(effects, drone.impairment(DroneTraffic::plans)); },
      .check_real = because("plans go from agent to link in shared memory")};
}

Result<FaultActs> reboot(const ParsedWords&) {
  return FaultActs{
      .strike = [](SimulatedWorld& world, std::size_t drone) { world.sim().restart(number_of(world, drone)); },
      .check_real = because(inside_the_simulation),
      .momentary = true,
      .pushes = true};
}

Result<FaultActs> lose_propeller(const ParsedWords&) {
  return FaultActs{
      .strike = [](SimulatedWorld& world, std::size_t drone) { world.sim().lose_propeller(number_of(world, drone)); },
      .check_real = because(inside_the_simulation),
      .momentary = true,
      .pushes = true,
      .breaks = true,
      .for_good = true};
}

Result<FaultActs> set_battery(const ParsedWords& said) {
  const auto share = share_of(said.words[0]);
  if (!share) return Error{"battery must be followed by a share, 0% to 100%"};
  return FaultActs{
      .strike = [share = *share](SimulatedWorld& world,
                                 std::size_t drone) { world.sim().set_battery(number_of(world, drone), share); },
      .check_real = because(inside_the_simulation),
      .momentary = true};
}

Result<FaultActs> heat(const ParsedWords& said) {
  constexpr double max_c = 150;
  const auto celsius = parse_number(said.words[0]);
  if (!celsius || *celsius < 0 || *celsius > max_c) return Error{"heat must be followed by 0 to 150 degrees Celsius"};
  return FaultActs{.strike = [celsius = *celsius](
                                 SimulatedWorld& world,
                                 std::size_t drone) { world.sim().set_temperature(number_of(world, drone), celsius); },
                   .check_real = because(inside_the_simulation),
                   .momentary = true};
}

Result<FaultActs> drain(const ParsedWords& said) {
  const auto share = share_of(said.words[0]);
  if (!share) return Error{"drain must be followed by a share a second, 0% to 100%"};
  return FaultActs{.lasts_on = [share = *share](Effects::OfDrone& drone, std::size_t) { drone.drain_per_s += share; },
                   .check_real = because(inside_the_simulation)};
}

Result<FaultActs> kick(const ParsedWords& said) {
  const auto velocity = vector_of(said.words);
  if (!velocity) return Error{"kick must be followed by three velocities in m/s"};
  return FaultActs{
      .strike = [velocity = *velocity](SimulatedWorld& world,
                                       std::size_t drone) { world.sim().kick(number_of(world, drone), velocity); },
      .check_real = because(inside_the_simulation),
      .momentary = true,
      .pushes = true};
}

// Winds add up.
Result<FaultActs> wind(const ParsedWords& said) {
  const auto velocity = vector_of(said.words);
  if (!velocity) return Error{"wind must be followed by three velocities in m/s"};
  return FaultActs{.lasts =
                       [velocity = *velocity](Effects& effects) {
                         for (std::size_t i = 0; i < 3; ++i) effects.wind_mps[i] += velocity[i];
                       },
                   .check_real = because(inside_the_simulation),
                   .pushes = true};
}

Result<FaultActs> sensor(const ParsedWords& said) {
  const auto fault = parse_sensor(said.rest);
  if (!fault) return fault.error();
  // A text that says the wrong velocity or heading, up to the other way round: all but the battery's.
  const double misleads_mps = said.rest.starts_with("bat") ? 0 : 2 * rc_full_mps;
  return FaultActs{
      .lasts_on =
          [fault = *fault](Effects::OfDrone& drone, std::size_t item) {
            drone.sensors.push_back(fault);
            drone.sensors.back().item = item;
          },
      .really_begin = [text = said.text](RealActs& real, const RealStack&) { real.proxy.push_back(text); },
      .really_end = [text = said.text](RealActs& real, const RealStack&, bool) { real.proxy.push_back(text + " off"); },
      .misleads_mps = misleads_mps};
}

// What link does not fly by.
Status with_mocap(const WorldConfig& flight) {
  const bool has = flight.pose == link::PoseSource::mocap || flight.pose == link::PoseSource::mocap_then_tello;
  return allow_if(has, "this flight has no motion capture (flight.pose)");
}

Result<FaultActs> of_mocap(void (*set)(MocapFault&, const std::array<double, 3>&), const std::array<double, 3>& value,
                           double misleads_m = 0) {
  return FaultActs{.lasts_on = [set, value](Effects::OfDrone& drone, std::size_t) { set(drone.mocap, value); },
                   .check_real = because(inside_the_simulation),
                   .check_flight = with_mocap,
                   .misleads_m = misleads_m};
}

Result<FaultActs> mocap_frozen(const ParsedWords&) {
  return of_mocap([](MocapFault& mocap, const auto&) { mocap.frozen = true; }, {});
}

Result<FaultActs> mocap_jump(const ParsedWords& said) {
  const auto offset = vector_of(said.words);
  if (!offset) return Error{"jump must be followed by three distances in m"};
  const auto add = [](MocapFault& mocap, const auto& metres) {
    for (std::size_t i = 0; i < 3; ++i) mocap.offset_m[i] += metres[i];
  };
  return of_mocap(add, *offset, std::hypot((*offset)[0], (*offset)[1], (*offset)[2]));
}

constexpr double max_creep_mps = 5;
constexpr double crept_m = 0.6;  // until link sees that its sources differ, and stops

Result<FaultActs> mocap_creep(const ParsedWords& said) {
  const auto velocity = vector_of(said.words);
  const double speed = velocity ? std::hypot((*velocity)[0], (*velocity)[1], (*velocity)[2]) : 0;
  if (speed <= 0 || speed > max_creep_mps) return Error{"creep must be followed by three velocities, up to 5 m/s"};
  const auto add = [](MocapFault& mocap, const auto& mps) {
    for (std::size_t i = 0; i < 3; ++i) mocap.creep_mps[i] += mps[i];
  };
  return of_mocap(add, *velocity, crept_m);
}

// How far a drone can fly the wrong way until link sees that it does not move as commanded.
constexpr double turned_m = 2;

Result<FaultActs> mocap_turn(const ParsedWords& said) {
  const auto degrees = parse_number(said.words[0]);
  if (!degrees || std::abs(*degrees) > 180) return Error{"turn must be followed by -180 to 180 degrees"};
  return of_mocap([](MocapFault& mocap, const auto& turns) { mocap.turn_rad += turns[0]; },
                  {*degrees * std::numbers::pi / 180}, turned_m);
}

Result<FaultActs> mocap_noise(const ParsedWords& said) {
  const auto sigma = parse_number(said.words[0]);
  if (!sigma || *sigma < 0 || *sigma > 100) return Error{"noise must be followed by 0 to 100 m"};
  return of_mocap([](MocapFault& mocap, const auto& metres) { mocap.noise_m = metres[0]; }, {*sigma}, 3 * *sigma);
}

Result<FaultActs> mocap_every(const ParsedWords& said) {
  const auto period = parse_time(said.words[0]);
  if (!period) return period.error();
  if (*period <= 0) return Error{"every must be followed by more than 0 s"};
  return FaultActs{
      .lasts_on = [period = *period](Effects::OfDrone& drone, std::size_t) { drone.mocap.period_ns = period; },
      .check_real = because(inside_the_simulation),
      .check_flight = with_mocap};
}

Result<FaultActs> mocap_effects(const ParsedWords& said) {
  const auto effects = effects_in(said.rest);
  if (!effects) return effects.error();
  return FaultActs{
      .lasts_on = [effects = *effects](Effects::OfDrone& drone,
                                       std::size_t) { overlay(effects, drone.impairment(DroneTraffic::mocap)); },
      .check_real = because("mocap goes past the proxy, by DDS"),
      .check_flight = with_mocap};
}

constexpr FaultKind drone_table[] = {
    {"drone NAME to|answers|states|from|both EFFECTS...", link_effects},
    {"drone NAME plans EFFECTS...", plan_effects},
    {"drone NAME reboot", reboot},
    {"drone NAME propeller", lose_propeller},
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
    {"mocap NAME EFFECTS...", mocap_effects},
    {"wind X Y Z", wind},
};

}  // namespace

std::span<const FaultKind> drone_faults() { return drone_table; }

}  // namespace ledgerline::hil
