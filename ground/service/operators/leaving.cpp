#include "ground/service/operators/leaving.hpp"

#include <algorithm>

#include "common/access/access.hpp"
#include "common/msg/stops.hpp"

namespace ledgerline::ground::service {

bool is_aloft(const FlightView& flights, std::size_t drone) {
  const DronePhase phase = flights.status(drone).phase;
  const IntakeState& seen = flights.seen(drone);
  return is_in_air(phase) || phase == DronePhase::landing || (seen.has_state && in_flight(seen.state.phase));
}

std::vector<std::size_t> aloft_of(const FlightView& flights) {
  std::vector<std::size_t> aloft;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    if (is_aloft(flights, drone) || !flights.seen(drone).has_state) aloft.push_back(drone);
  }
  return aloft;
}

std::vector<std::size_t> stopped_by_ground(const FlightView& flights) {
  const Identity ground = to_message(flights.config().self);
  std::vector<std::size_t> stopped;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    const Control& stoppers = flights.lease(drone).stoppers;
    // A ground that is a supervisor would clear the others' stops with its own.
    if (stoppers.stoppers_size() == 1 && is_stopped_by(stoppers, ground)) stopped.push_back(drone);
  }
  return stopped;
}

Held held_by(const FlightView& flights, const crypto::IdentityName& who) {
  Held held;
  for (std::size_t drone = 0; drone < flights.drones().size(); ++drone) {
    if (flights.lease(drone).holder != who || flights.lease(drone).commander != flights.config().self) continue;
    held.drones.push_back(drone);
    if (is_aloft(flights, drone)) held.aloft.push_back(drone);
  }
  return held;
}

void Leaving::add(std::size_t who, TimeNs from_ns) {
  remove(who);
  all_.push_back({who, from_ns, from_ns + limit_ns, from_ns});
}

void Leaving::remove(std::size_t who) {
  std::erase_if(all_, [&](const Gone& one) { return one.who == who; });
}

bool Leaving::has(std::size_t who) const {
  return std::any_of(all_.begin(), all_.end(), [&](const Gone& one) { return one.who == who; });
}

std::vector<std::size_t> Leaving::all() const {
  std::vector<std::size_t> who;
  for (const Gone& one : all_) who.push_back(one.who);
  return who;
}

Leaving::Step Leaving::step(TimeNs now_ns, std::size_t who, const Held& held) {
  const auto gone = std::find_if(all_.begin(), all_.end(), [&](const Gone& one) { return one.who == who; });
  Step step;
  if (gone == all_.end() || now_ns < gone->from_ns) return step;
  step.last = now_ns >= gone->until_ns;
  step.give_back = held.aloft.empty() || step.last;
  if (step.give_back || now_ns < gone->next_ns) return step;
  gone->next_ns = now_ns + again_ns;
  step.land = held.aloft;
  return step;
}

}  // namespace ledgerline::ground::service
