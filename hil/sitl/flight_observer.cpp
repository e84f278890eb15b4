#include "hil/sitl/flight_observer.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "hil/netem/text_parse.hpp"
#include "hil/sitl/world_setup.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::hil {

namespace {

void put(std::string& key, const auto& value) { key.append(reinterpret_cast<const char*>(&value), sizeof value); }

/// All that a drone does by a plan, and which plan it is.
std::string key_of(const DronePlan& plan) {
  std::string key;
  put(key, static_cast<int>(plan.action()));
  put(key, std::uint64_t{plan.epoch()});
  put(key, std::uint64_t{plan.sequence()});
  put(key, TimeNs{plan.state_stamp_ns()});
  for (const PlannedSetpoint& s : plan.setpoints()) {
    put(key, TimeNs{s.at_ns()});
    for (const float value : {s.vx(), s.vy(), s.vz(), s.yaw_rate()}) put(key, value);
  }
  return key;
}

std::string key_of(const Plan& plan) {
  std::string key;
  put(key, static_cast<int>(plan.action));
  put(key, std::uint64_t{plan.epoch});
  put(key, std::uint64_t{plan.sequence});
  put(key, TimeNs{plan.state_stamp_ns});
  for (std::uint32_t i = 0; i < plan.count; ++i) {
    const Setpoint& s = plan.setpoints[i];
    put(key, TimeNs{s.at_ns});
    for (const float value : {s.velocity_mps[0], s.velocity_mps[1], s.velocity_mps[2], s.yaw_rate_radps})
      put(key, value);
  }
  return key;
}

}  // namespace

FlightObserver::FlightObserver(const WorldConfig& config, const sim::Simulator& sim) {
  for (int k = 1; k <= config.drones; ++k) {
    DroneObservation observation;
    observation.name = drone_name(k);
    observation.number = static_cast<DroneNumber>(k);
    const sim::Truth truth = sim.truth(observation.number);
    observation.start_m = {truth.position_m[0], truth.position_m[1]};
    const ground::Path course = course_of(config, k, observation.start_m);
    observation.corners = corners_of(course);
    observation.laps = task_of(config, k).laps;
    if (config.manual) courses_.push_back(course);
    drones_.push_back(observation);
    asked_.emplace_back();
  }
}

void FlightObserver::note(TimeNs now, WorldEvent::Kind kind, std::size_t drone, std::string text) {
  noted_.push_back({now, kind, drone, 0, std::move(text)});
}

void FlightObserver::begin_step() { events_ = std::exchange(noted_, {}); }

void FlightObserver::on_poses(const std::vector<Pose>& poses) {
  for (const Pose& pose : poses) drones_[pose.drone - 1U].pose = pose;
}

void FlightObserver::on_plans(TimeNs now, TimeNs host_slept_ns, const std::vector<Plan>& plans) {
  for (const Plan& plan : plans) {
    DroneObservation& observation = drones_[plan.drone - 1U];
    // From the first word on, however often it is said.
    if (plan.action == PlanAction::land && observation.phase == LinkPhase::flying && observation.land_until_ns == 0)
      observation.land_until_ns = now + from_seconds(link::SeparationSettings{}.landing_wait_s);
    if (plan.action != PlanAction::fly || plan.count == 0 || plan.count > max_setpoints) continue;
    const link::PlayoutSettings settings;
    const TimeNs last = plan.setpoints[plan.count - 1].at_ns;
    const TimeNs hold = plan.count == 1 ? settings.default_hold_ns
                                        : std::min(last - plan.setpoints[plan.count - 2].at_ns, settings.max_hold_ns);
    observation.sent_until_ns = std::max(observation.sent_until_ns, last + hold + host_slept_ns);
    ++observation.plans_given;
  }
}

void FlightObserver::on_call_signed(const fabric::Call& call) {
  if (call.args.empty()) return;
  const auto act_on = [&](const std::string& drone, const auto& act) {
    const auto named = std::ranges::find(drones_, drone, &DroneObservation::name);
    if (named != drones_.end()) act(asked_[static_cast<std::size_t>(named - drones_.begin())]);
  };
  CommandCall command;
  DronesCall stop;  // or clear_stop
  if (call.function == contract::command && parse_message(call.args[0], command)) {
    for (const DronePlan& plan : command.plans())
      act_on(plan.drone(), [&](SignedRequests& drone) { drone.plans.insert(key_of(plan)); });
  } else if ((call.function == contract::stop || call.function == contract::clear_stop) &&
             parse_message(call.args[0], stop)) {
    const bool stops = call.function == contract::stop;
    for (const std::string& name : stop.drones()) {
      act_on(name, [&](SignedRequests& drone) {
        (stops ? drone.stop : drone.clear_stop) = true;
        drone.cut = drone.cut || (stops && stop.cut());
      });
    }
  }
}

void FlightObserver::on_call_committed(const fabric::Call& call) {
  DronesCall stop;
  if (call.function != contract::stop || call.args.empty() || !parse_message(call.args[0], stop)) return;
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    const auto& names = stop.drones();
    if (std::find(names.begin(), names.end(), drones_[i].name) != names.end()) asked_[i].stopped = true;
  }
}

void FlightObserver::on_state_reported(const StateSample& state) {
  constexpr std::size_t kept = 4096;  // four seconds at a thousand a second; ground takes older ones no more
  auto& said = asked_[state.drone - 1U].said;
  said.push_back(state);
  if (said.size() > kept) said.pop_front();
}

void FlightObserver::on_state_shown(TimeNs now, std::size_t drone, const StateSample& state) {
  const auto& said = asked_[drone].said;
  const auto same = [&](const StateSample& one) {
    return one.boot_id == state.boot_id && one.sequence == state.sequence;
  };
  const auto found = std::find_if(said.rbegin(), said.rend(), same);
  if (found == said.rend()) return;  // too old to be known here
  if (found->stamp_ns == state.stamp_ns && found->position_m == state.position_m && found->phase == state.phase) return;
  events_.push_back({now, WorldEvent::Kind::unasked, drone, 0, "ground flies by a state that link never said"});
}

void FlightObserver::check_handed(TimeNs now, const Plan& plan) {
  const SignedRequests& asked = asked_[plan.drone - 1U];
  const bool known = plan.action == PlanAction::stop                    ? asked.stop
                     : plan.action == PlanAction::cut                   ? asked.cut
                     : plan.action == PlanAction::stop_cleared          ? asked.clear_stop || !asked.stopped
                     : plan.action == PlanAction::stop_cleared_by_owner ? asked.clear_stop
                                                                        : asked.plans.contains(key_of(plan));
  if (known) return;
  events_.push_back(
      {now, WorldEvent::Kind::unasked, plan.drone - 1U, 0, "agent hands on what nobody signed", plan.sequence});
}

void FlightObserver::on_plan_handed(TimeNs now, const Plan& plan) {
  if (link::is_empty_plan(plan)) return;  // nobody's: a lease has ended
  check_handed(now, plan);
  if (is_contract_action(plan.action)) return;
  events_.push_back({now, WorldEvent::Kind::handed, plan.drone - 1U, 0, {}, plan.sequence});
}

void FlightObserver::on_command_sent(TimeNs now, DroneNumber drone, std::string_view command, double yaw_rad) {
  const std::size_t i = drone - 1U;
  const auto words = words_of(command);
  if (words.empty() || words[0] != "rc") {
    events_.push_back({now, WorldEvent::Kind::sent, i, 0, std::string(command)});
    return;
  }
  std::array<double, 4> sticks{};
  bool good = words.size() == 5;
  for (std::size_t k = 0; good && k < 4; ++k) {
    const auto value = parse_number(words[k + 1]);
    good = value && std::abs(*value) <= 100;
    if (good) sticks[k] = *value / 100 * rc_full_mps;
  }
  if (!good) events_.push_back({now, WorldEvent::Kind::bad_rc, i, 0, std::string(command)});
  DroneObservation& observation = drones_[i];
  observation.sent_mps = std::hypot(sticks[0], sticks[1], sticks[2]);
  // rc is right, forward, up
  const Eigen::Vector2d on_map = Eigen::Rotation2Dd(yaw_rad) * Eigen::Vector2d(sticks[1], -sticks[0]);
  observation.sent = {on_map.x(), on_map.y(), sticks[2]};
  observation.sent_ns = now;
}

void FlightObserver::on_trace(TimeNs now, const TraceRecord& record) {
  DroneObservation& observation = drones_[record.drone - 1U];
  if (record.kind == TraceKind::mode) {
    observation.phase = static_cast<LinkPhase>(record.id);
    observation.mode = static_cast<FailsafeMode>(record.extra);
    observation.cause = static_cast<FailsafeCause>(static_cast<int>(record.v[0]));
    if (observation.phase != LinkPhase::flying) observation.land_until_ns = 0;
    events_.push_back({now, WorldEvent::Kind::mode, record.drone - 1U, 0, {}});
  } else if (record.kind == TraceKind::command_applied) {
    events_.push_back(
        {now, WorldEvent::Kind::applied, record.drone - 1U, to_seconds(record.t_ns - record.stamp_ns), {}, record.id});
  }
}

void FlightObserver::on_link_ended() {
  for (DroneObservation& observation : drones_) {
    observation.phase = LinkPhase::disconnected;
    observation.mode = FailsafeMode::none;
    observation.cause = FailsafeCause::none;
    observation.sent_until_ns = observation.land_until_ns = observation.made_room_ns = observation.plan_end_ns = 0;
  }
}

void FlightObserver::end_step(TimeNs now, const sim::Simulator& sim, const ground::FlightCore* ground,
                              const link::LinkCore* link) {
  for (WorldEvent& event : std::exchange(noted_, {})) events_.push_back(std::move(event));
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    DroneObservation& observation = drones_[i];
    observation.truth = sim.truth(observation.number);
    if (link) {
      const TimeNs sent_ns =
          observation.sent_until_ns == 0 ? 0 : observation.sent_until_ns + link->margin_ns(observation.number);
      if (observation.mode != FailsafeMode::none && link->makes_room(observation.number))
        observation.made_room_ns = now;
      observation.plan_end_ns = std::max({sent_ns, observation.land_until_ns, observation.made_room_ns});
    }
    observation.off_path_m.reset();
    const auto& at_m = observation.truth.position_m;
    if (!courses_.empty() && on_course(observation.truth))
      observation.off_path_m = courses_[i].distance_m({at_m[0], at_m[1]});
    if (!ground) continue;
    const ground::FlightStatus& status = ground->status(i);
    observation.ground_phase = status.phase;
    observation.finished = status.finished;
    observation.lap = status.lap;
    if (status.phase == ground::GroundPhase::path)
      observation.off_path_m =
          ground->follower(i)->path().distance_m({observation.truth.position_m[0], observation.truth.position_m[1]});
  }
}

bool FlightObserver::all_down() const {
  return std::all_of(drones_.begin(), drones_.end(), [](const DroneObservation& observation) {
    return on_ground(observation.truth) && !is_in_flight(observation.phase);
  });
}

}  // namespace ledgerline::hil
