#include "ground/core/flight/planner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "ground/core/flight/phases.hpp"

namespace ledgerline::ground {
namespace {

constexpr TimeNs beside_ns = 5 * ns_per_ms;  // without a ledger: until link has the plan

void write(const Reference& reference, PlannedReference& out) {
  out.set_x(reference.position_m[0]);
  out.set_y(reference.position_m[1]);
  out.set_z(reference.position_m[2]);
  out.set_vx(reference.velocity_mps[0]);
  out.set_vy(reference.velocity_mps[1]);
  out.set_vz(reference.velocity_mps[2]);
  out.set_ax(reference.acceleration_mps2[0]);
  out.set_ay(reference.acceleration_mps2[1]);
  out.set_az(reference.acceleration_mps2[2]);
}

void write(const Response& response, LearnedResponse& out) {
  out.set_gain(static_cast<float>(response.gain));
  out.set_lag_s(static_cast<float>(response.lag_s));
  out.set_dead_s(static_cast<float>(response.dead_s));
}

}  // namespace

Planner::Planner(const FlightConfig& config, std::size_t drone, const Lease& lease, const IntakeState& seen,
                 FlightStatus& status)
    : config_(config),
      drone_(drone),
      lease_(lease),
      seen_(seen),
      status_(status),
      task_(task_of(config, drone)),
      manual_(config.controller, config.cmd_timeout_ns) {}

Status Planner::make_follower(const std::vector<Waypoint>& waypoints, const Eigen::Vector2d& origin_m, double yaw_rad,
                              int laps) {
  ControllerConfig config = config_.controller;
  config.speed_mps = task_.speed_mps;
  if (config_.follower) {
    auto made = config_.follower({config_.drones[drone_].name, waypoints, origin_m, yaw_rad, laps}, config);
    if (!made) return made.error();
    follower_ = std::move(*made);
    return done;
  }
  if (!model_ || model_boot_id_ != seen_.state.boot_id) model_ = std::make_shared<DroneModel>(config);
  model_boot_id_ = seen_.state.boot_id;
  auto own = std::make_unique<PathController>(waypoints, origin_m, config, yaw_rad, model_);
  controller_ = own.get();
  follower_ = std::move(own);
  return done;
}

Status Planner::begin_path(const std::array<double, 2>& origin_m, double yaw_rad) {
  const std::vector<Waypoint> waypoints = waypoints_of(task_);
  const Eigen::Vector2d origin(origin_m[0], origin_m[1]);
  if (Status made = make_follower(waypoints, origin, yaw_rad, task_.laps); !made) return made;
  for (std::size_t i = 0; i <= waypoints.size(); ++i) {
    const Waypoint& waypoint = waypoints[i % waypoints.size()];
    const Eigen::Vector2d at = origin + waypoint.at_m;
    status_.planned.push_back({at.x(), at.y(), waypoint.height_m.value_or(config_.controller.height_m)});
  }
  return done;
}

Status Planner::begin_pilot_path(const std::vector<Waypoint>& way, bool land_behind, TimeNs from_ns) {
  const StateSample& state = seen_.state;
  const Waypoint here{{state.position_m[0], state.position_m[1]}, state.position_m[2]};
  PilotPath path(way, land_behind, here, config_.controller.height_m);
  const motion::OpenPath& course = path.course();
  if (Status made = make_follower(course.waypoints, course.origin_m, state.yaw_rad, 1); !made) return made;
  follower_->observe(state);
  follower_->start(from_ns, path.end_m(*follower_));
  manual_.release();
  status_.planned = path.corners();
  pilot_path_ = std::move(path);
  return done;
}

void Planner::start_path(TimeNs at_ns) {
  lap_since_ns_ = last_at_ns_ = at_ns;
  follower_->start(at_ns,
                   config_.seconds > 0 ? std::numeric_limits<double>::infinity() : task_.laps * follower_->lap_m());
}

void Planner::observe(bool same_boot) {
  if (!same_boot) {
    first_setpoint_ns_ = 0;
    manual_ = ManualController(config_.controller, config_.cmd_timeout_ns);
    display_model_.reset();
  }
  if (seen_.state.phase != LinkPhase::flying) return;
  if (config_.manual || config_.follower) {
    if (!display_model_) display_model_ = DroneModel(config_.controller).predictor;
    display_model_->observe(seen_.state);
  }
  if (follower_) follower_->observe(seen_.state);
  if (pilot_path_ && status_.phase == GroundPhase::path) pilot_path_->observe(*follower_, seen_.state);
}

bool Planner::needs_plan() const {
  const GroundPhase phase = status_.phase;
  const StateSample& state = seen_.state;
  if (!is_flown(phase) || !lease_.may_command) return false;
  // What is done already is not asked for again: that plan would come too late to mean anything.
  if (state.phase == LinkPhase::landing && phase == GroundPhase::landing) return false;
  if (state.phase == LinkPhase::taking_off && phase == GroundPhase::takeoff) return false;
  // Nor what link would refuse now.
  if (state.phase != LinkPhase::flying && phase == GroundPhase::takeoff && !may_take_off(state, config_.manual))
    return false;
  // Nor a path without a pose: link brakes, and a plan from nowhere would say nothing.
  return state.phase != LinkPhase::flying || phase == GroundPhase::landing || by_hand() || follower_->ready();
}

std::optional<PlannedCommand> Planner::make(TimeNs now, const PlanTiming::Timing& timing) {
  if (!needs_plan()) return std::nullopt;
  PlannedCommand command;
  command.made_ns = now;
  command.made_on_drone_ns = seen_.state.stamp_ns + (now - seen_.received_ns);
  DronePlan& plan = command.plan;
  plan.set_drone(config_.drones[drone_].name);
  plan.set_boot_id(seen_.state.boot_id);
  plan.set_state_stamp_ns(seen_.state.stamp_ns);
  plan.set_epoch(lease_.epoch);
  plan.set_body_frame(by_hand() && status_.phase != GroundPhase::landing);
  if (status_.phase == GroundPhase::landing) {
    plan.set_action(LAND);
  } else if (seen_.state.phase != LinkPhase::flying) {
    plan.set_action(TAKEOFF);
  } else {
    plan.set_action(FLY);
    command.id = next_plan_++;
    const std::vector<Setpoint> planned = setpoints(now, command, timing);
    if (planned.empty()) return std::nullopt;
    if (display_model_) display_model_->sent(command.id, planned, plan.body_frame());
    for (const Setpoint& setpoint : planned) {
      PlannedSetpoint* p = plan.add_setpoints();
      p->set_at_ns(setpoint.at_ns);
      p->set_vx(setpoint.velocity_mps[0]);
      p->set_vy(setpoint.velocity_mps[1]);
      p->set_vz(setpoint.velocity_mps[2]);
      p->set_yaw_rate(setpoint.yaw_rate_radps);
      if (setpoint.has_reference) write(setpoint.reference, *p->mutable_reference());
    }
    if (planned.front().has_reference && controller_)
      write(controller_->predictor().response(), *plan.mutable_response());
    if (status_.phase == GroundPhase::path && !config_.manual) count_laps(first_setpoint_ns_);
    if (follower_) command.progress_m = follower_->progress_m();
    report();
  }
  ++status_.commands.made;
  return command;
}

TimeNs Planner::next_first_ns(TimeNs made_on_drone_ns, const PlanTiming::Timing& timing) const {
  const TimeNs ahead_ns = plain() ? 0 : config_.ledger ? timing.delay_ns : beside_ns;
  return std::max(first_setpoint_ns_, made_on_drone_ns + ahead_ns);
}

std::vector<Setpoint> Planner::setpoints(TimeNs now, const PlannedCommand& command, const PlanTiming::Timing& timing) {
  first_setpoint_ns_ = next_first_ns(command.made_on_drone_ns, timing);
  if (by_hand()) return manual_.plan(now, first_setpoint_ns_);
  // Not sooner than the plan before it, even where the delay fell: then shorter.
  const TimeNs last_ns = command.made_on_drone_ns + timing.farthest_ns;
  const TimeNs room = (last_ns - first_setpoint_ns_) / PathController::step_ns;
  const auto steps = static_cast<std::size_t>(std::max<TimeNs>(0, room));
  return follower_->plan(command.id, first_setpoint_ns_, std::min(timing.steps, steps));
}

std::optional<CommittedPath> Planner::committed(TimeNs now, const PlanTiming::Timing& timing) const {
  const StateSample& state = seen_.state;
  // As link decides it: DroneLink::may_follow().
  const bool follows =
      state.phase == LinkPhase::flying && (state.mode == FailsafeMode::none || state.mode == FailsafeMode::hold);
  if (!seen_.has_state || !follows || !is_in_air(status_.phase) || !lease_.may_command || plain()) return std::nullopt;
  const bool ours = model_ && model_boot_id_ == state.boot_id;
  const motion::Predictor* model = display_model_ ? &*display_model_ : ours ? &model_->predictor : nullptr;
  if (model == nullptr) return std::nullopt;
  const TimeNs now_on_drone_ns = state.stamp_ns + (now - seen_.received_ns);
  const std::vector<motion::Motion> motions = model->committed(now_on_drone_ns, CommittedPath::max_points);
  if (motions.empty()) return std::nullopt;
  CommittedPath path;
  for (const motion::Motion& motion : motions) path.points_m.push_back(motion.position_m);
  path.step_ns = motions[1].stamp_ns - motions[0].stamp_ns;
  path.until_ns = motions.back().stamp_ns - motions.front().stamp_ns;
  path.predicted_m = model->until(next_first_ns(now_on_drone_ns, timing)).effect().position_m;
  return path;
}

void Planner::report() {
  if (follower_ && !config_.manual) status_.lap_m = follower_->lap_m();
  if (!controller_) return;
  status_.limit_mps = config_.controller.predict && !by_hand() ? controller_->limit_mps() : 0;
  status_.slowed_to_mps = controller_->slowed_to_mps();
  status_.response = controller_->predictor().response();
}

void Planner::count_laps(TimeNs at_ns) {
  const double length_m = follower_->lap_m();
  const double progress_m = follower_->progress_m();
  while (progress_m > last_progress_m_) {
    const double lap_end_m = static_cast<double>(status_.lap_s.size() + 1) * length_m;
    if (progress_m < lap_end_m - 1e-9) break;
    const double share = (lap_end_m - last_progress_m_) / (progress_m - last_progress_m_);
    const TimeNs end_ns = last_at_ns_ + static_cast<TimeNs>(share * static_cast<double>(at_ns - last_at_ns_));
    status_.lap_s.push_back(to_seconds(end_ns - lap_since_ns_));
    lap_since_ns_ = end_ns;
  }
  last_progress_m_ = progress_m;
  last_at_ns_ = at_ns;
  status_.lap = static_cast<int>(status_.lap_s.size()) + (follower_->at_end() ? 0 : 1);
}

namespace {

// The reference runs ahead of the drone by a leash at most (ControllerConfig::leash_m), so one that is two beyond a
// waypoint has the drone beyond it, too, however wide it flew.
constexpr double surely_behind_m = 0.8;

std::vector<Waypoint> with_heights(std::vector<Waypoint> way, double height_m) {
  for (Waypoint& waypoint : way) waypoint.height_m = waypoint.height_m.value_or(height_m);
  return way;
}

}  // namespace

PilotPath::PilotPath(std::vector<Waypoint> way, bool land_behind, const Waypoint& here, double height_m)
    : way_(with_heights(std::move(way), height_m)),
      land_behind_(land_behind),
      here_(here),
      course_(motion::open_path(here_, way_)) {}

void PilotPath::observe(const Follower& follower, const StateSample& state) {
  for (; next_ + 1 < way_.size(); ++next_) {
    const double beyond_m = follower.progress_m() - follower.length_to(course_.first + next_);
    if (beyond_m < 0) return;
    const double away_m =
        std::hypot(state.position_m[0] - way_[next_].at_m.x(), state.position_m[1] - way_[next_].at_m.y());
    if (away_m >= near_m && beyond_m < surely_behind_m) return;
  }
}

bool PilotPath::at_end(const Follower& follower, const StateSample& state) const {
  return follower.at_end() && is_settled(state, {way_.back().at_m.x(), way_.back().at_m.y(), *way_.back().height_m});
}

std::vector<Waypoint> PilotPath::rest() const {
  return {way_.begin() + static_cast<std::ptrdiff_t>(next_), way_.end()};
}

std::vector<std::array<double, 3>> PilotPath::corners() const {
  std::vector<std::array<double, 3>> corners;
  if (course_.first > 0) corners.push_back({here_.at_m.x(), here_.at_m.y(), here_.height_m.value_or(0)});
  for (const Waypoint& waypoint : way_)
    corners.push_back({waypoint.at_m.x(), waypoint.at_m.y(), waypoint.height_m.value_or(0)});
  return corners;
}

}  // namespace ledgerline::ground
