// FlightCore and a drone's pilot: what is wished, and what becomes of it.
#include <fmt/format.h>

#include <functional>

#include "common/msg/contract.hpp"
#include "ground/core/flight_state.hpp"

namespace ledgerline::ground {
namespace {

/// A stop that did not reach the ledger by then is given up, aloud: drone and ground have landed it long since.
constexpr TimeNs stop_within_ns = 30 * ns_per_s;
constexpr TimeNs note_again_ns = 1 * ns_per_s;

/// Of the pauses' jitter: pilots that stop at one time do not come back together.
std::uint64_t seed_of(const crypto::IdentityName& self, std::size_t drone) {
  return std::hash<std::string>{}(self.msp_id + self.subject) + drone;
}

}  // namespace

void FlightCore::take_wish(TimeNs now_ns, const PilotWish& wish, FlightOutputs& out) {
  if (wish.drone >= drones_.size()) return;
  Drone& drone = *drones_[wish.drone];
  drone.wished = true;
  const bool stop = wish.stop || wish.cut;
  if (stop && (!drone.stop || (wish.cut && !drone.stop->cut()))) {
    drone.stop.emplace();
    drone.stop->add_drones(drone.who.name);
    drone.stop->set_cut(wish.cut);
    drone.stop_repeat.emplace(fabric::RepeatLimits{.within_ns = stop_within_ns}, seed_of(config_.self, drone.index),
                              now_ns);
    drone.stop_id = 0;  // what may be under way asks for less
    drone.next_stop_ns = now_ns;
  }
  if (stop || wish.land) {
    const char* why = stop ? "stopped by its pilot" : config_.manual ? "" : "landed by its pilot";
    if (drone.in_air_phase()) land(now_ns, drone, why);
    if (drone.status.phase == DronePhase::failed && drone.has_state && in_flight(drone.state.phase))
      enter(now_ns, drone, DronePhase::landing);
  } else if (wish.takeoff) {
    take_off(now_ns, drone, out);
  }
  drone.status.pilot.replaced += wish.replaced;
  drone.status.pilot.bad_values += wish.bad_values;
  drone.status.pilot.malformed += wish.malformed;
  if (wish.velocity) take_velocity(wish, drone);
}

void FlightCore::take_velocity(const PilotWish& wish, Drone& drone) {
  PilotCounters& counters = drone.status.pilot;
  if (drone.status.phase != DronePhase::manual) {
    ++counters.not_flying;
  } else if (!drone.manual.take(wish.came_ns, *wish.velocity)) {
    ++counters.bad_values;
  } else {
    ++counters.velocities;
  }
}

void FlightCore::take_off(TimeNs now_ns, Drone& drone, FlightOutputs& out) {
  std::string why = not_ready(drone);
  if (drone.status.phase == DronePhase::landing) why = "it is landing";
  if (ending_) why = "the flight is ending";
  if (drone.in_air_phase()) why = "it is in the air";
  if (!config_.manual) why = "it flies a path";
  if (!why.empty()) {
    refuse(now_ns, drone, "no take-off: " + why, out);
    return;
  }
  drone.flew = false;
  drone.manual.release();
  drone.status.why.clear();
  drone.status.origin_m = {drone.state.position_m[0], drone.state.position_m[1]};
  enter(now_ns, drone, DronePhase::takeoff);
}

// Counted always, said once a second: a pilot's messages may come as fast as they like.
void FlightCore::refuse(TimeNs now_ns, Drone& drone, const std::string& why, FlightOutputs& out) {
  ++drone.status.pilot.refused;
  if (now_ns < drone.next_note_ns) return;
  drone.next_note_ns = now_ns + note_again_ns;
  out.notes.push_back(fmt::format("{}: {}", drone.who.name, why));
}

void FlightCore::submit_stops(TimeNs now_ns, FlightOutputs& out) {
  for (auto& drone : drones_) {
    if (!drone->stop || drone->stop_id != 0 || now_ns < drone->next_stop_ns) continue;
    drone->stop_id = next_id_++;
    out.submissions.push_back({drone->stop_id, {contract::stop, {drone->stop->SerializeAsString()}}, true});
  }
}

bool FlightCore::take_stop_outcome(TimeNs now_ns, const fabric::Outcome& outcome, std::uint64_t id,
                                   FlightOutputs& out) {
  for (auto& drone : drones_) {
    if (drone->stop_id != id) continue;
    drone->stop_id = 0;
    using Next = fabric::Repeat::Next;
    const Next next = drone->stop_repeat->ended(now_ns, outcome);
    drone->next_stop_ns = drone->stop_repeat->at_ns();
    if (next == Next::again) return true;
    drone->stop.reset();
    if (next == Next::refused) refuse(now_ns, *drone, fmt::format("no stop: {}", outcome.refusal->words), out);
    if (next == Next::given_up)
      refuse(now_ns, *drone,
             fmt::format("no stop: not on the ledger within {:.0f} s: {}", to_seconds(stop_within_ns), outcome.message),
             out);
    return true;
  }
  return false;
}

}  // namespace ledgerline::ground
