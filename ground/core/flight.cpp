#include "ground/core/flight.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/base/enum_count.hpp"
#include "ground/core/flight_state.hpp"

namespace ledgerline::ground {
namespace {

constexpr double near_m = 0.2;  // of a place: close enough to call it reached
constexpr double still_mps = 0.2;
constexpr TimeNs grounded_for_ns = 2 * ns_per_s;  // a take-off command may still be under way
constexpr TimeNs beside_ns = 5 * ns_per_ms;       // without a ledger: until link has the plan
constexpr TimeNs end_wait_ns = 3 * ns_per_s;      // for the drone to come up to the path's end
constexpr TimeNs new_enough_ns =
    200 * ns_per_ms;  // a state to make a plan from at once; agent takes none beyond 500 ms

std::string_view name_of(FailsafeCause cause) {
  constexpr std::array names{"no cause given",
                             "its plan ran out",
                             "held too long without commands",
                             "agent is silent",
                             "the ledger is silent",
                             "its state is stale",
                             "its pose is lost",
                             "it is at the fence",
                             "battery low",
                             "battery critical",
                             "stopped"};
  static_assert(names.size() == enum_count<FailsafeCause>);
  const auto i = static_cast<std::size_t>(cause);
  return i < names.size() ? names[i] : "unknown cause";
}

// On the ground link says what speaks against a take-off. A stop it keeps until the next take-off command; whether that
// is allowed says the ledger.
bool may_take_off(const StateSample& state) {
  return state.cause == FailsafeCause::none || state.cause == FailsafeCause::stopped;
}

}  // namespace

std::string name_of(DronePhase phase) {
  constexpr std::array names{"waiting", "takeoff", "path", "manual", "landing", "landed", "failed"};
  static_assert(names.size() == enum_count<DronePhase>);
  return names[static_cast<std::size_t>(phase)];
}

FlightCore::FlightCore(FlightConfig config) : config_(std::move(config)) {
  for (std::size_t i = 0; i < config_.drones.size(); ++i) {
    auto drone = std::make_unique<Drone>(config_);
    drone->who = config_.drones[i];
    drone->index = i;
    drones_.push_back(std::move(drone));
  }
}

FlightCore::~FlightCore() = default;

FlightCore::Drone* FlightCore::find(std::string_view name) {
  for (auto& drone : drones_) {
    if (drone->who.name == name) return drone.get();
  }
  return nullptr;
}

FlightOutputs FlightCore::step(TimeNs now_ns, const FlightInputs& inputs) {
  if (started_ns_ == 0) {
    started_ns_ = now_ns;
    for (auto& drone : drones_) drone->entered_ns = now_ns;
  }
  FlightOutputs out;
  if (inputs.outcome) take_outcome(now_ns, *inputs.outcome, inputs.outcome_id, out);
  if (inputs.block) take_block(now_ns, inputs, out);
  for (const StateSample& state : inputs.states) {
    const auto of = [&](const auto& drone) { return drone->who.number == state.drone; };
    const auto drone = std::find_if(drones_.begin(), drones_.end(), of);
    if (drone != drones_.end()) take_state(now_ns, **drone, state, out);
  }
  const bool time_is_up = config_.manual && config_.seconds > 0 && now_ns - started_ns_ > from_seconds(config_.seconds);
  ending_ = ending_ || (config_.manual && (time_is_up || !inputs.land.empty()));
  for (const PilotWish& wish : inputs.wishes) take_wish(now_ns, wish, out);
  for (auto& drone : drones_) {
    if (ending_ && drone->in_air_phase()) land(now_ns, *drone, "");
    if (!inputs.land.empty() && !config_.manual) land(now_ns, *drone, inputs.land);
    if (drone->fresh) advance(now_ns, *drone);
    if (drone->fresh || (drone->wished && now_ns - drone->received_ns < new_enough_ns)) make_plan(now_ns, *drone);
    drone->fresh = drone->wished = false;
    check_time(now_ns, *drone);
    if (drone->status.slowed_to_mps && !std::exchange(drone->slowed_said, true)) {
      out.notes.push_back(fmt::format(
          "{}: slowed to {:.2f} m/s: at the age that its commands are flown with, more might leave the path",
          drone->who.name, *drone->status.slowed_to_mps));
    }
  }
  submit_stops(now_ns, out);
  if (!config_.ledger) {
    hand_over_plans(now_ns, out);
  } else if (!inputs.more) {
    submit_pending(now_ns, out);
  }
  return out;
}

void FlightCore::enter(TimeNs now_ns, Drone& drone, DronePhase phase) {
  drone.status.phase = phase;
  drone.entered_ns = now_ns;
}

void FlightCore::land(TimeNs now_ns, Drone& drone, const std::string& why) {
  if (drone.status.phase >= DronePhase::landing) return;
  end_path(drone);
  if (drone.status.why.empty()) drone.status.why = why;
  enter(now_ns, drone, drone.status.phase == DronePhase::waiting ? DronePhase::failed : DronePhase::landing);
}

void FlightCore::end_path(Drone& drone) {
  if (drone.status.phase == DronePhase::path || drone.status.phase == DronePhase::manual)
    drone.status.path_ns[1] = drone.state.stamp_ns;
}

bool FlightCore::settled(const Drone& drone) const {
  const auto& s = drone.state;
  const auto& origin = drone.status.origin_m;
  return std::hypot(s.position_m[0] - origin[0], s.position_m[1] - origin[1]) < near_m &&
         std::abs(s.position_m[2] - drone.controller->start_height_m()) < near_m &&
         std::hypot(s.velocity_mps[0], s.velocity_mps[1], s.velocity_mps[2]) < still_mps;
}

// On a new state: which phase is it now?
void FlightCore::advance(TimeNs now_ns, Drone& drone) {
  const StateSample& s = drone.state;
  const bool grounded = s.phase == FlightPhase::on_ground || s.phase == FlightPhase::landed;
  const bool flying = s.phase == FlightPhase::flying;
  switch (drone.status.phase) {
    case DronePhase::waiting:
      if (config_.manual) {
        // Found in the air, it is held there: see takeoff.
        if (flying && not_ready(drone).empty()) enter(now_ns, drone, DronePhase::takeoff);
        return;
      }
      if (!may_command(drone) || s.pose_stamp_ns == 0 || !(grounded || flying)) return;
      if (grounded && !may_take_off(s)) return;
      drone.status.origin_m = {s.position_m[0], s.position_m[1]};
      drone.controller = std::make_unique<PathController>(
          waypoints(config_), Eigen::Vector2d(s.position_m[0], s.position_m[1]), config_.controller, s.yaw_rad);
      enter(now_ns, drone, DronePhase::takeoff);
      return;
    case DronePhase::takeoff:
      if (!flying) {
        if (drone.flew) land(now_ns, drone, fmt::format("came down by itself: {}", name_of(s.cause)));
        return;
      }
      if (!drone.flew) drone.settling_since_ns = s.stamp_ns;
      drone.flew = true;
      if (config_.manual) {
        drone.status.path_ns = {s.stamp_ns, 0};
        enter(now_ns, drone, DronePhase::manual);
        return;
      }
      if (settled(drone)) {
        drone.path_since_ns = drone.lap_since_ns = drone.last_at_ns = s.stamp_ns + timing(drone).delay_ns;
        drone.controller->start(drone.path_since_ns, config_.seconds > 0 ? std::numeric_limits<double>::infinity()
                                                                         : config_.laps * drone.controller->lap_m());
        drone.status.path_ns[0] = drone.path_since_ns;
        enter(now_ns, drone, DronePhase::path);
      } else if (s.stamp_ns - drone.settling_since_ns > config_.settle_ns) {
        land(now_ns, drone,
             fmt::format("did not settle above where it took off within {:.0f} s", to_seconds(config_.settle_ns)));
      }
      return;
    case DronePhase::path:
    case DronePhase::manual:
      advance_flown(now_ns, drone);
      return;
    case DronePhase::landing:
      if (grounded && (drone.flew || now_ns - drone.entered_ns > grounded_for_ns))
        enter(now_ns, drone, DronePhase::landed);
      return;
    case DronePhase::landed:
    case DronePhase::failed:
      return;
  }
}

void FlightCore::advance_flown(TimeNs now_ns, Drone& drone) {
  const StateSample& s = drone.state;
  if (s.phase != FlightPhase::flying) {
    land(now_ns, drone, fmt::format("came down by itself: {}", name_of(s.cause)));
  } else if (s.mode == FailsafeMode::land || s.mode == FailsafeMode::cut) {
    land(now_ns, drone, fmt::format("its failsafe landed it: {}", name_of(s.cause)));
  } else if (drone.status.phase == DronePhase::path) {
    advance_path(now_ns, drone);
  }
}

void FlightCore::advance_path(TimeNs now_ns, Drone& drone) {
  const StateSample& s = drone.state;
  if (config_.seconds > 0) {
    const double share = to_seconds(s.stamp_ns - drone.path_since_ns) / config_.seconds;
    drone.status.progress = std::clamp(share, 0.0, 1.0);
    drone.status.finished = share >= 1;
  } else {
    drone.status.progress = drone.controller->progress_m() / (config_.laps * drone.controller->lap_m());
    if (drone.controller->at_end()) {
      if (drone.end_since_ns == 0) drone.end_since_ns = s.stamp_ns;
      const auto& origin = drone.status.origin_m;
      drone.status.finished = std::hypot(s.position_m[0] - origin[0], s.position_m[1] - origin[1]) < near_m;
      if (!drone.status.finished && s.stamp_ns - drone.end_since_ns > end_wait_ns) {
        land(now_ns, drone, "did not reach the end of its path");
      }
    }
  }
  if (!drone.status.finished) return;
  end_path(drone);
  enter(now_ns, drone, DronePhase::landing);
}

TimeNs FlightCore::path_limit_ns(const Drone& drone) const {
  constexpr double spare_s = 30;
  if (config_.seconds > 0) return from_seconds(config_.seconds + spare_s);
  return from_seconds(config_.path_factor * drone.controller->expected_s(config_.laps) + spare_s);
}

// What speaks against a take-off; empty: nothing.
std::string FlightCore::not_ready(const Drone& drone) const {
  if (!drone.has_state) return "no state came through the ledger";
  if (is_stopped(drone.stoppers)) return "it is stopped by " + stopper_names(drone.stoppers);
  if (!may_command(drone))
    return drone.holder ? "its lease is held by " + drone.holder->subject : "nobody holds its lease";
  if (drone.state.pose_stamp_ns == 0) return "it has no pose (no mocap?)";
  if (drone.state.phase == FlightPhase::disconnected) return "link does not reach it";
  if (!in_flight(drone.state.phase) && !may_take_off(drone.state))
    return fmt::format("it may not take off ({})", name_of(drone.state.cause));
  return "";
}

void FlightCore::check_time(TimeNs now_ns, Drone& drone) {
  const TimeNs in_phase_ns = now_ns - drone.entered_ns;
  if (drone.in_air_phase() && now_ns - drone.received_ns > config_.silence_ns) {
    land(now_ns, drone, fmt::format("no state came for {:.1f} s", to_seconds(config_.silence_ns)));
    return;
  }
  switch (drone.status.phase) {
    case DronePhase::waiting: {
      if (config_.manual || in_phase_ns <= config_.wait_ns) return;
      const std::string missing = not_ready(drone);
      drone.status.why =
          fmt::format("{} within {:.0f} s", missing.empty() ? "it never was ready on the ground" : missing,
                      to_seconds(config_.wait_ns));
      enter(now_ns, drone, DronePhase::failed);
      return;
    }
    case DronePhase::takeoff:
      if (in_phase_ns > config_.takeoff_ns) {
        land(now_ns, drone, fmt::format("did not take off within {:.0f} s", to_seconds(config_.takeoff_ns)));
      }
      return;
    case DronePhase::path:
      if (in_phase_ns > path_limit_ns(drone)) {
        land(now_ns, drone, fmt::format("did not finish its path within {:.0f} s", to_seconds(path_limit_ns(drone))));
      }
      return;
    case DronePhase::landing:
      if (in_phase_ns > config_.landing_ns) {
        const std::string silent = fmt::format("was not seen to land within {:.0f} s", to_seconds(config_.landing_ns));
        drone.status.why += (drone.status.why.empty() ? "" : "; ") + silent;
        enter(now_ns, drone, DronePhase::failed);
      }
      return;
    case DronePhase::manual:
    case DronePhase::landed:
    case DronePhase::failed:
      return;
  }
}

void FlightCore::count_laps(Drone& drone, TimeNs at_ns) {
  const double length_m = drone.controller->lap_m();
  const double progress_m = drone.controller->progress_m();
  while (progress_m > drone.last_progress_m) {
    const double lap_end_m = static_cast<double>(drone.status.lap_s.size() + 1) * length_m;
    if (progress_m < lap_end_m - 1e-9) break;
    const double share = (lap_end_m - drone.last_progress_m) / (progress_m - drone.last_progress_m);
    const TimeNs end_ns = drone.last_at_ns + static_cast<TimeNs>(share * static_cast<double>(at_ns - drone.last_at_ns));
    drone.status.lap_s.push_back(to_seconds(end_ns - drone.lap_since_ns));
    drone.lap_since_ns = end_ns;
  }
  drone.last_progress_m = progress_m;
  drone.last_at_ns = at_ns;
  drone.status.lap = static_cast<int>(drone.status.lap_s.size()) + (drone.controller->at_end() ? 0 : 1);
}

void FlightCore::make_plan(TimeNs now_ns, Drone& drone) {
  const DronePhase phase = drone.status.phase;
  const bool active = drone.in_air_phase() || phase == DronePhase::landing;
  if (!active || !may_command(drone)) return;
  // What is done already is not asked for again: that plan would come too late to mean anything.
  if (drone.state.phase == FlightPhase::landing && phase == DronePhase::landing) return;
  if (drone.state.phase == FlightPhase::taking_off && phase == DronePhase::takeoff) return;
  // Nor what link would refuse now.
  if (drone.state.phase != FlightPhase::flying && phase == DronePhase::takeoff && !may_take_off(drone.state)) return;
  // Nor a path without a pose: link brakes, and a plan from nowhere would say nothing.
  if (drone.state.phase == FlightPhase::flying && phase != DronePhase::landing && !config_.manual &&
      !drone.controller->predictor().ready()) {
    return;
  }
  PlannedCommand command;
  command.made_ns = now_ns;
  command.made_stamp_ns = drone.state.stamp_ns + (now_ns - drone.received_ns);
  DronePlan& plan = command.plan;
  plan.set_drone(drone.who.name);
  plan.set_boot_id(drone.state.boot_id);
  plan.set_state_stamp_ns(drone.state.stamp_ns);
  plan.set_epoch(drone.epoch);
  if (phase == DronePhase::landing) {
    plan.set_action(LAND);
  } else if (drone.state.phase != FlightPhase::flying) {
    plan.set_action(TAKEOFF);
  } else {
    plan.set_action(FLY);
    const bool plain = !config_.manual && !config_.controller.predict;  // its command is for now, whenever it comes
    const TimeNs ahead_ns = plain ? 0 : config_.ledger ? timing(drone).delay_ns : beside_ns;
    drone.first_setpoint_ns = std::max(drone.first_setpoint_ns, command.made_stamp_ns + ahead_ns);
    command.id = drone.next_plan++;
    std::vector<Setpoint> setpoints;
    if (config_.manual) {
      setpoints = drone.manual.plan(command.id, now_ns, drone.first_setpoint_ns);
    } else {
      // Not sooner than the plan before it, even where the delay fell: then shorter.
      const TimeNs last_ns = command.made_stamp_ns + timing(drone).farthest_ns;
      const TimeNs room = (last_ns - drone.first_setpoint_ns) / PathController::step_ns;
      const auto steps = static_cast<std::size_t>(std::max<TimeNs>(0, room));
      setpoints = drone.controller->plan(command.id, drone.first_setpoint_ns, std::min(timing(drone).steps, steps));
    }
    for (const Setpoint& setpoint : setpoints) {
      PlannedSetpoint* p = plan.add_setpoints();
      p->set_at_ns(setpoint.at_ns);
      p->set_vx(setpoint.velocity_mps[0]);
      p->set_vy(setpoint.velocity_mps[1]);
      p->set_vz(setpoint.velocity_mps[2]);
      p->set_yaw_rate(setpoint.yaw_rate_radps);
    }
    if (phase == DronePhase::path) count_laps(drone, drone.first_setpoint_ns);
    if (drone.controller) {
      command.progress_m = drone.controller->progress_m();
      drone.status.lap_m = drone.controller->lap_m();
      drone.status.limit_mps = config_.controller.predict ? drone.controller->limit_mps() : 0;
      drone.status.slowed_to_mps = drone.controller->slowed_to_mps();
      drone.status.response = drone.controller->predictor().response();
    }
  }
  ++drone.status.commands_made;
  if (drone.pending) {
    ++drone.status.commands_merged;
    plan.set_sequence(drone.pending->plan.sequence());  // never sent, or refused with others: free to be used again
    forget(*drone.pending);
  }
  drone.pending = std::move(command);
}

bool FlightCore::done() const {
  // A stop is the ledger's business beyond this flight.
  if (std::any_of(drones_.begin(), drones_.end(), [](const auto& d) { return d->stop.has_value(); })) return false;
  if (config_.manual) {
    return ending_ && std::none_of(drones_.begin(), drones_.end(), [](const auto& d) {
             return d->in_air_phase() || d->status.phase == DronePhase::landing;
           });
  }
  return std::all_of(drones_.begin(), drones_.end(),
                     [](const auto& d) { return d->status.phase >= DronePhase::landed; });
}

bool FlightCore::ok() const {
  return std::all_of(drones_.begin(), drones_.end(), [&](const auto& d) {
    if (config_.manual) return d->status.phase != DronePhase::failed && d->status.why.empty();
    return d->status.finished && d->status.phase == DronePhase::landed && d->status.why.empty();
  });
}

std::string FlightCore::why() const {
  std::string all;
  for (const auto& drone : drones_) {
    if (drone->status.why.empty()) continue;
    all += fmt::format("{}{}: {}", all.empty() ? "" : "; ", drone->who.name, drone->status.why);
  }
  return all;
}

FlightStatus FlightCore::status(std::size_t drone) const { return drones_.at(drone)->status; }

TimeNs FlightCore::delay_ns() const {
  TimeNs max_ns = 0;
  for (const auto& drone : drones_) max_ns = std::max(max_ns, timing(*drone).delay_ns);
  return max_ns;
}

const PathController* FlightCore::controller(std::size_t drone) const { return drones_.at(drone)->controller.get(); }

std::vector<Waypoint> FlightCore::waypoints(const FlightConfig& config) {
  return config.waypoints.empty() ? motion::waypoints_of(config.shape, config.side_m) : config.waypoints;
}

bool FlightCore::may_command(const Drone& drone) const { return !config_.ledger || drone.may_command(config_.self); }

}  // namespace ledgerline::ground
