#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "sim/simulator.hpp"

/// How many times real time the simulator runs on a virtual clock, all drones flying: 1 and 16 drones in turns.
namespace {

using namespace ledgerline;

double times_real_time(int drones) {
  sim::Parameters parameters;
  parameters.drones = drones;
  sim::Simulator simulator(parameters, 0);
  const sim::Endpoint client{0x0a000001, 40000};
  TimeNs now = 0;
  const auto tell = [&](std::string_view text) {
    for (int drone = 1; drone <= drones; ++drone) {
      simulator.datagram(static_cast<DroneNumber>(drone), client, text);
    }
  };
  const auto run = [&](double seconds) {
    for (const TimeNs end = now + from_seconds(seconds); now < end; now += ns_per_ms) simulator.step(now);
  };
  tell("command");
  run(0.5);
  tell("takeoff");
  run(8);
  constexpr double seconds = 60, turn_s = 0.5;
  const TimeNs begin = monotonic_ns();
  for (double flown = 0; flown < seconds; flown += turn_s) {
    tell(static_cast<int>(flown / 4) % 2 == 0 ? "rc 20 0 0 0" : "rc -20 0 0 0");
    run(turn_s);
  }
  const double wall_s = to_seconds(monotonic_ns() - begin);
  int flying = 0;
  for (int drone = 1; drone <= drones; ++drone) {
    if (simulator.truth(static_cast<DroneNumber>(drone)).in_flight) ++flying;
  }
  if (flying != drones) fmt::print("only {} of {} drones fly\n", flying, drones);
  return seconds / wall_s;
}

}  // namespace

int main() {
  constexpr int turns = 7;
  std::vector<double> one, sixteen;
  for (int i = 0; i < turns; ++i) {
    one.push_back(times_real_time(1));
    sixteen.push_back(times_real_time(16));
  }
  for (auto [name, speeds] : {std::pair{" 1 drone ", &one}, std::pair{"16 drones", &sixteen}}) {
    std::sort(speeds->begin(), speeds->end());
    fmt::print("{}: {:.0f} times real time (median of {}; {:.0f} to {:.0f})\n", name, (*speeds)[turns / 2], turns,
               speeds->front(), speeds->back());
  }
}
