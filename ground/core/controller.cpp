#include "ground/core/controller.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ledgerline::ground {
namespace {

// The reference must leave a corner at which it would stand still.
constexpr double creep_mps = 0.05;

double wrap(double angle) { return std::remainder(angle, 2 * std::numbers::pi); }

}  // namespace

PathController::PathController(Path path, ControllerConfig config, double yaw_rad)
    : path_(std::move(path)), config_(config), yaw_rad_(yaw_rad), prediction_(config.lag_s) {}

void PathController::start(TimeNs from_ns, double end_m) {
  started_ = true;
  end_m_ = end_m;
  reference_ns_ = from_ns;
}

// As fast as a constant acceleration allows between the corners, each passed at a speed that falls with its angle.
double PathController::speed_at(double s_m) const {
  const auto at_corner = [&](double angle_rad) {
    const double share = std::clamp(1.5 - angle_rad / std::numbers::pi, 0.25, 1.5);  // 1 at 90 degrees
    return std::min(config_.speed_mps, config_.corner_speed_mps * share);
  };
  const auto reachable = [&](double from_mps, double distance_m) {
    return std::sqrt(from_mps * from_mps + 2 * config_.acceleration_mps2 * std::max(0.0, distance_m));
  };
  const Path::Turn turns = path_.turns(s_m);
  double speed = std::min({config_.speed_mps, reachable(at_corner(turns.ahead_rad), turns.ahead_m),
                           reachable(at_corner(turns.behind_rad), turns.behind_m)});
  speed = std::min({speed, reachable(0, s_m), reachable(0, end_m_ - s_m)});  // from rest, to rest
  return std::max(speed, std::min(creep_mps, config_.speed_mps));
}

// The share of its speed that the reference moves with: whole up to half the leash, none at its end.
double PathController::pace(double s_m, const Eigen::Vector2d& drone) const {
  if (!started_ || s_m >= end_m_) return 0;
  return std::clamp(2.0 - 2.0 * (path_.point(s_m) - drone).norm() / config_.leash_m, 0.0, 1.0);
}

double PathController::advance(double s_m, const Eigen::Vector2d& drone, double dt_s) const {
  return std::min(std::max(s_m, end_m_), s_m + pace(s_m, drone) * speed_at(s_m) * dt_s);
}

Setpoint PathController::steer(const Motion& from, double s_m) const {
  const Eigen::Vector2d target = path_.point(s_m);
  Eigen::Vector2d reference = Eigen::Vector2d::Zero();
  Eigen::Vector2d lead = Eigen::Vector2d::Zero();
  // A reference that waits has no velocity: with it the drone would come to rest beside a reference that waits for it.
  if (const double share = pace(s_m, from.position_m.head<2>()); share > 0) {
    constexpr double ds_m = 0.01;
    const double speed = speed_at(s_m);
    // v dv/ds within the piece; a corner's change of direction is left to the corrections.
    const double to_corner_m = std::min(path_.turns(s_m).ahead_m, end_m_ - s_m);
    const double ahead_m = std::min(ds_m, 0.5 * to_corner_m);
    const double acceleration = ahead_m > 1e-6 ? speed * (speed_at(s_m + ahead_m) - speed) / ahead_m : 0.0;
    const double bound = config_.acceleration_mps2;
    reference = share * speed * path_.direction(s_m);
    lead = share * config_.lag_s * std::clamp(acceleration, -bound, bound) * path_.direction(s_m);
  }
  Eigen::Vector2d wanted = reference + lead + config_.position_gain * (target - from.position_m.head<2>()) +
                           config_.velocity_gain * (reference - from.velocity_mps.head<2>());
  const double most = 1.5 * config_.speed_mps + 0.3;
  if (wanted.norm() > most) wanted *= most / wanted.norm();
  const double vertical = std::clamp(config_.height_gain * (config_.height_m - from.position_m.z()),
                                     -config_.max_vertical_mps, config_.max_vertical_mps);
  const double yaw_rate = std::clamp(config_.yaw_gain * wrap(yaw_rad_ - from.yaw_rad), -config_.max_yaw_rate_radps,
                                     config_.max_yaw_rate_radps);
  Setpoint setpoint;
  setpoint.velocity_mps = {static_cast<float>(wanted.x()), static_cast<float>(wanted.y()),
                           static_cast<float>(vertical)};
  setpoint.yaw_rate_radps = static_cast<float>(yaw_rate);
  return setpoint;
}

std::vector<Setpoint> PathController::plan(const Motion& state, TimeNs first_ns) {
  predicted_ = prediction_.at(state, first_ns);
  reference_ns_ = started_ ? std::max(reference_ns_, first_ns - Prediction::longest_ns) : first_ns;
  while (reference_ns_ < first_ns) {
    const TimeNs dt_ns = std::min(step_ns, first_ns - reference_ns_);
    progress_m_ = advance(progress_m_, predicted_.position_m.head<2>(), to_seconds(dt_ns));
    reference_ns_ += dt_ns;
  }

  std::vector<Setpoint> plan;
  Motion now = predicted_;
  double s_m = progress_m_;
  const double dt_s = to_seconds(step_ns);
  for (std::size_t i = 0; i < steps; ++i) {
    Setpoint setpoint = steer(now, s_m);
    setpoint.at_ns = first_ns + static_cast<TimeNs>(i) * step_ns;
    plan.push_back(setpoint);
    now = prediction_.move(now, setpoint, dt_s);
    s_m = advance(s_m, now.position_m.head<2>(), dt_s);
  }

  prediction_.sent(state, plan);
  return plan;
}

}  // namespace ledgerline::ground
