#include "ground/service/core/drone_queries.hpp"

#include "common/access/access.hpp"
#include "common/access/stops.hpp"
#include "ground/core/flight/phases.hpp"

namespace ledgerline::ground::service {

namespace {

template <typename Holds>
std::vector<std::size_t> drones_where(const FlightView& flights, const Holds& holds) {
  std::vector<std::size_t> found;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    if (holds(drone)) found.push_back(drone);
  }
  return found;
}

}  // namespace

bool is_aloft(const FlightView& flights, std::size_t drone) {
  const IntakeState& seen = flights.intake(drone);
  return is_flown(flights.status(drone).phase) || (seen.has_state && is_in_flight(seen.state.phase));
}

std::vector<std::size_t> aloft_of(const FlightView& flights) {
  return drones_where(flights,
                      [&](std::size_t drone) { return is_aloft(flights, drone) || !flights.intake(drone).has_state; });
}

std::vector<std::size_t> stopped_of(const FlightView& flights) {
  return drones_where(flights, [&](std::size_t drone) { return flights.lease(drone).stoppers.stoppers_size() > 0; });
}

std::vector<std::size_t> unplaced_of(const FlightView& flights) {
  return drones_where(flights, [&](std::size_t drone) {
    const IntakeState& seen = flights.intake(drone);
    return seen.has_state && seen.state.pose_stamp_ns == 0;
  });
}

std::vector<std::size_t> stopped_by_ground(const FlightView& flights) {
  const Identity ground = to_message(flights.config().self);
  return drones_where(flights, [&](std::size_t drone) {
    const Control& stoppers = flights.lease(drone).stoppers;
    // A ground that is a supervisor would clear the others' stops with its own.
    return stoppers.stoppers_size() == 1 && is_stopped_by(stoppers, ground);
  });
}

std::vector<LeaseState> leases_of(const FlightView& flights) {
  std::vector<LeaseState> leases;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    const Lease& lease = flights.lease(drone);
    leases.push_back({.holder = lease.holder,
                      .words = lease.holder ? "its lease is held by " + holder_words(lease) : "nobody holds its lease",
                      .ours = !flights.config().ledger || lease.commander == flights.config().self});
  }
  return leases;
}

HeldDrones drones_held_by(const FlightView& flights, const crypto::IdentityName& who) {
  HeldDrones held;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    if (flights.lease(drone).holder != who || flights.lease(drone).commander != flights.config().self) continue;
    held.drones.push_back(drone);
    if (is_aloft(flights, drone)) held.aloft.push_back(drone);
  }
  return held;
}

}  // namespace ledgerline::ground::service
