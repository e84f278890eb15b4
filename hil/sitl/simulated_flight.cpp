#include "hil/sitl/simulated_flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "hil/sitl/world.hpp"

namespace ledgerline::hil {
namespace {

constexpr TimeNs truth_period_ns = 33 * ns_per_ms;

/// Follows each drone on its path.
class Observer {
 public:
  explicit Observer(SimulatedWorld& world)
      : world_(world), tracking_(world.drones().size()), heights_(world.drones().size()) {}

  SimulatedFlightResult fly(TimeNs max_ns) {
    TimeNs next_truth_ns = 0;
    while (!world_.ground_done() && world_.now() < max_ns) {
      world_.step();
      if (world_.now() < next_truth_ns) continue;
      next_truth_ns = world_.now() + truth_period_ns;
      for (std::size_t i = 0; i < tracking_.size(); ++i) track(i);
    }
    return result();
  }

 private:
  void track(std::size_t i) {
    const DroneObservation& drone = world_.drones()[i];
    if (!drone.off_path_m) return;
    const double height_m = drone.truth.position_m[2];
    if (tracking_[i].empty()) heights_[i] = {height_m, height_m};
    heights_[i] = {std::min(heights_[i].first, height_m), std::max(heights_[i].second, height_m)};
    const auto& v = drone.truth.velocity_mps;
    tracking_[i].emplace_back(world_.now(), *drone.off_path_m, std::hypot(v[0], v[1]));
  }

  SimulatedFlightResult result() const {
    SimulatedFlightResult result;
    result.ok = world_.ok();
    result.why = world_.ground_done() ? world_.why() : fmt::format("not over after {:.0f} s", to_seconds(world_.now()));
    result.flown_ns = world_.now();
    result.blocks = world_.blocks();
    result.transactions = world_.transactions();
    if (world_.agent()) result.violations = world_.agent()->integrity().count();
    result.digest = world_.digest();
    const auto reports = world_.link()->reports();
    for (std::size_t i = 0; i < reports.size(); ++i) {
      const ground::FlightStatus status = world_.ground()->status(i);
      SimulatedFlightResult::Drone drone;
      drone.name = reports[i].name;
      drone.two_way_ms = world_.two_way_ms(i);
      drone.age_ms = reports[i].age_ms;
      std::tie(drone.cross_track_rms_m, drone.cross_track_max_m, std::ignore) = flown(i, 0, world_.now());
      std::tie(drone.lowest_m, drone.highest_m) = heights_[i];
      drone.lap_s = status.lap_s;
      drone.laps = laps(i, status);
      drone.limit_mps = status.limit_mps;
      drone.slowed_to_mps = status.slowed_to_mps;
      drone.response = status.response;
      drone.commands_sent = status.commands.sent;
      drone.commands_applied = reports[i].plans.applied;
      result.drones.push_back(std::move(drone));
    }
    return result;
  }

  // Rms and greatest cross-track error and greatest speed between two moments.
  std::tuple<double, double, double> flown(std::size_t drone, TimeNs from_ns, TimeNs to_ns) const {
    double squares = 0, most = 0, fastest = 0;
    std::uint64_t count = 0;
    for (const auto& [t_ns, error, speed] : tracking_[drone]) {
      if (t_ns < from_ns || t_ns >= to_ns) continue;
      squares += error * error;
      most = std::max(most, error);
      fastest = std::max(fastest, speed);
      ++count;
    }
    return {count ? std::sqrt(squares / static_cast<double>(count)) : 0, most, fastest};
  }

  std::vector<SimulatedFlightResult::Drone::Lap> laps(std::size_t i, const ground::FlightStatus& status) const {
    std::vector<SimulatedFlightResult::Drone::Lap> laps;
    const ground::PathController* controller = world_.ground()->controller(i);
    TimeNs from_ns = status.path_ns[0];
    for (const double lap_s : status.lap_s) {
      const TimeNs to_ns = from_ns + from_seconds(lap_s);
      SimulatedFlightResult::Drone::Lap lap;
      lap.asked_mps = controller->requested_mps((static_cast<double>(laps.size()) + 0.5) * controller->lap_m());
      lap.flown_mps = controller->lap_m() / lap_s;
      lap.seconds = lap_s;
      std::tie(lap.rms_m, lap.max_m, lap.peak_mps) = flown(i, from_ns, to_ns);
      laps.push_back(lap);
      from_ns = to_ns;
    }
    return laps;
  }

  SimulatedWorld& world_;
  std::vector<std::vector<std::tuple<TimeNs, double, double>>> tracking_;  ///< of each: cross-track error and speed
  std::vector<std::pair<double, double>> heights_;                         ///< lowest and highest of each, on its path
};

}  // namespace

Result<SimulatedFlightResult> fly_simulated(const SimulatedFlightConfig& config) {
  if (config.model_error < -0.5 || config.model_error > 1)
    return Error{fmt::format("a model error of {}: -0.5 to 1 can be flown", config.model_error)};
  if (config.mode == SimulatedFlightConfig::Mode::local && !config.delays.added.none())
    return Error{"a local flight has no ledger that could be delayed"};
  WorldConfig settings = config;
  if (config.max_age_ns == 0)
    settings.max_age_ns = config.delays.added.none() ? WorldConfig{}.max_age_ns : 5 * ns_per_s;
  auto world = SimulatedWorld::create(settings);
  if (!world) return world.error();
  return Observer(**world).fly(config.max_ns);
}

}  // namespace ledgerline::hil
