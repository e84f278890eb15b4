// Faults of what the simulated drones sense: light, floor, flow, tof, barometer, mission pads.
#include <algorithm>
#include <cmath>

#include "hil/fault/kinds/parse.hpp"

namespace ledgerline::hil {
namespace {

using ParsedText = FaultKind::ParsedText;

constexpr double max_bias_mps = 5, max_baro_drift_mps = 10;

/// What `set` does to a drone's Sensing while the fault goes on. `pushes`: its own velocity is wrong, so that it
/// drifts, and how fast and how far it gets says nothing about its controller. `misleads_mps`: how fast it drifts from
/// the position by its onboard odometry. `blinds`: its own velocity is lost, and physics alone bounds how far it gets
/// (Invariants::blind_way_m), no speed: who steers it is to notice.
template <class Set>
FaultActs senses(Set set, bool pushes, double misleads_mps = 0, bool blinds = false) {
  return FaultActs{.lasts_on = [set](Effects::OfDrone& drone, std::size_t) { set(drone.sensing); },
                   .check_real = because(inside_the_simulation),
                   .pushes = pushes,
                   .blinds = blinds,
                   .misleads_mps = misleads_mps};
}

Result<FaultActs> flow_lost(const ParsedText&) {
  return senses([](sim::Sensing& sensing) { sensing.light = 0; }, false, 0, true);
}

Result<FaultActs> light_or_floor(const ParsedText& parsed) {
  const auto share = parse_share(parsed.words[1]);
  if (!share || *share >= sim::SensorParameters{}.flow_needs)
    return Error{std::string(parsed.words[0]) + " must be followed by a share below 20%: with more, flow is not lost"};
  double sim::Sensing::*const which = parsed.words[0] == "light" ? &sim::Sensing::light : &sim::Sensing::floor;
  return senses([which, share = *share](sim::Sensing& sensing) { sensing.*which = std::min(sensing.*which, share); },
                false, 0, true);
}

// Biases add up, and so do drifts.
Result<FaultActs> flow_bias(const ParsedText& parsed) {
  std::array<double, 2> bias{};
  for (std::size_t i = 0; i < 2; ++i) {
    const auto value = parse_number(parsed.words[i]);
    if (!value || std::abs(*value) > max_bias_mps)
      return Error{"flow bias must be followed by two velocities in m/s, east and north, up to 5"};
    bias[i] = *value;
  }
  if (bias[0] == 0 && bias[1] == 0) return Error{"flow bias of nothing does nothing"};
  return senses(
      [bias](sim::Sensing& sensing) {
        for (std::size_t i = 0; i < 2; ++i) sensing.flow_bias_mps[i] += bias[i];
      },
      true, std::hypot(bias[0], bias[1]));
}

Result<FaultActs> tof_nothing(const ParsedText&) {
  return senses([](sim::Sensing& sensing) { sensing.tof = false; }, false);
}

Result<FaultActs> imu_invalid(const ParsedText&) {
  return senses([](sim::Sensing& sensing) { sensing.imu = false; }, false);
}

Result<FaultActs> baro_drift(const ParsedText& parsed) {
  const auto rate = parse_number(parsed.words[0]);
  if (!rate || *rate == 0 || std::abs(*rate) > max_baro_drift_mps)
    return Error{"baro drift must be followed by a rate in m/s, up to 10 and not 0"};
  return senses([rate = *rate](sim::Sensing& sensing) { sensing.baro_drift_mps += rate; }, false, std::abs(*rate));
}

Result<FaultActs> pads_gone(const ParsedText&) {
  return FaultActs{.lasts =
                       [](Effects& effects) {
                         for (Effects::OfDrone& drone : effects.drones) drone.sensing.pads = false;
                       },
                   .check_real = because(inside_the_simulation),
                   .check_flight = [](const WorldConfig& flight) -> Status {
                     return allow_if(!flight.pads.empty(), "there are none on the floor (flight.pads)");
                   }};
}

constexpr FaultKind sensing_table[] = {
    {"drone NAME flow lost", flow_lost},        {"drone NAME light|floor SHARE", light_or_floor},
    {"drone NAME flow bias X Y", flow_bias},    {"drone NAME tof nothing", tof_nothing},
    {"drone NAME baro drift RATE", baro_drift}, {"pads gone", pads_gone},
    {"drone NAME imu invalid", imu_invalid},
};

}  // namespace

std::span<const FaultKind> sensing_faults() { return sensing_table; }

}  // namespace ledgerline::hil
