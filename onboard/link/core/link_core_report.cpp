// What LinkCore says about itself.
#include "onboard/link/core/link_core.hpp"

#include <algorithm>

namespace ledgerline::link {
namespace {

bool may_fly(const TelloSession& session) noexcept { return in_flight(session.phase()) || session.may_fly_unseen(); }

}  // namespace

bool LinkCore::all_on_ground() const noexcept {
  return std::none_of(drones_.begin(), drones_.end(), [](const Drone& d) { return may_fly(d.session); });
}

bool LinkCore::all_on_ground_or_unheard() const noexcept {
  return std::none_of(drones_.begin(), drones_.end(),
                      [](const Drone& d) { return may_fly(d.session) && d.session.heard(); });
}

bool LinkCore::all_landed_or_told() const noexcept {
  return std::none_of(drones_.begin(), drones_.end(),
                      [&](const Drone& d) { return may_fly(d.session) && !d.session.told_to_land(last_step_ns_); });
}

FlightPhase LinkCore::phase(DroneNumber number) const noexcept {
  const Drone* drone = find(number);
  return drone ? drone->session.phase() : FlightPhase::disconnected;
}

FailsafeMode LinkCore::mode(DroneNumber number) const noexcept {
  const Drone* drone = find(number);
  return drone ? drone->failsafe.mode : FailsafeMode::none;
}

TimeNs LinkCore::margin_ns(DroneNumber number) const noexcept {
  const Drone* drone = find(number);
  return drone ? drone->playout.margin_ns() : 0;
}

void LinkCore::finish() noexcept {
  for (Drone& drone : drones_) drone.playout.clear(DropReason::superseded);
}

std::vector<DroneReport> LinkCore::reports() const {
  std::vector<DroneReport> reports;
  reports.reserve(drones_.size());
  for (const Drone& drone : drones_) {
    const FlightPhase phase = drone.session.phase();
    reports.push_back(
        {.name = drone.name,
         .number = drone.number,
         .states_sampled = drone.states_sampled,
         .plans = drone.playout.counters(),
         .transitions = drone.transitions.counters(),
         .age_ms = drone.age.quantiles_ms(),
         .heard = drone.session.heard(),
         .landed = drone.session.has_flown() && (phase == FlightPhase::on_ground || phase == FlightPhase::landed),
         .phase = phase});
  }
  return reports;
}

}  // namespace ledgerline::link
