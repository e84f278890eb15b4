#include "hil/sitl/mission_station.hpp"

#include <algorithm>
#include <utility>

namespace ledgerline::hil {
namespace {

using ground::mission::MissionRun;

ground::mission::Mission mission_of(const WorldConfig& config) {
  const sim::Parameters places = sim_parameters(config);
  ground::mission::Mission mission{.name = "courses", .drones = {}};
  for (int k = 1; k <= config.drones; ++k) {
    const auto start_m = sim::start_of(places, k);
    ground::mission::MissionDrone drone{.drone = drone_name(k), .waypoints = ground::waypoints_of(task_of(config, k))};
    for (ground::Waypoint& waypoint : drone.waypoints) waypoint.at_m += Eigen::Vector2d(start_m[0], start_m[1]);
    drone.land_behind = true;
    mission.drones.push_back(std::move(drone));
  }
  return mission;
}

}  // namespace

MissionStation::MissionStation(const WorldConfig& config) {
  rules_.after_restart = config.after_restart;
  const link::FenceSettings fence = link_settings(config).fence;
  fence_ = {fence.min_m, fence.max_m};
  if (auto run = MissionRun::make(mission_of(config), rules_)) run_ = std::move(*run);
}

void MissionStation::approve() {
  const std::vector<ground::mission::Approval> approvals{{operator_name, run_->digest()}};
  if (approved_) run_->set_approvals(approvals);
}

std::vector<ground::mission::Finding> MissionStation::check(const ground::mission::Mission& mission,
                                                            const ground::FlightCore& core) const {
  const ground::FlightView view(core);
  std::vector<ground::mission::DroneNow> now = ground::mission::drones_now(view);
  for (std::size_t i = 0; i < now.size(); ++i) now[i].way = ground::mission::way_of(view, i);
  return ground::mission::check(mission, {.flight = core.config().controller, .fence = fence_}, now);
}

Status MissionStation::allowed(const ground::mission::Mission& mission, const ground::FlightCore& core) const {
  const auto findings = check(mission, core);
  const auto found = std::find_if(findings.begin(), findings.end(), [](const auto& one) { return one.forbids; });
  if (found != findings.end()) return Error{found->words};
  return done;
}

Status MissionStation::apply(MissionCommand word, const ground::FlightCore& core) {
  if (!run_) return Error{"there is no mission"};
  said_ = true;
  switch (word) {
    case MissionCommand::approve:
      approved_ = true;
      approve();
      return done;
    case MissionCommand::start:
      return run_->start(check(run_->mission(), core));
    case MissionCommand::pause:
      return run_->pause();
    case MissionCommand::resume:
      if (auto may = allowed(run_->rest(), core); !may) return may;
      return run_->resume();
    case MissionCommand::land:
      return run_->end("its operator has all land");
  }
  return done;
}

std::vector<ground::PilotCommand> MissionStation::step(TimeNs now, const ground::FlightCore& core) {
  if (!run_ || !said_) return {};
  auto commands = run_->step(now, ground::mission::drones_now(core)).commands;
  if (!run_->awaits_check()) return commands;
  run_->resume_after_check(allowed(run_->rest(), core));
  return commands;
}

void MissionStation::ground_ended() {
  if (!run_) return;
  kept_ = run_->saved();
  run_.reset();
}

void MissionStation::ground_began() {
  if (run_ || kept_.empty()) return;
  if (auto run = MissionRun::restore(kept_, rules_)) run_ = std::move(*run);
  if (run_) approve();
}

}  // namespace ledgerline::hil
