#include "ground/core/manual.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace ledgerline::ground {
namespace {

motion::PredictorConfig of_yaw() {
  motion::PredictorConfig config;
  config.learn = false;
  return config;
}

}  // namespace

bool believable(const Twist& wish) {
  const auto within = [](const std::array<double, 3>& values) {
    return std::all_of(values.begin(), values.end(),
                       [](double v) { return std::abs(v) <= absurd_speed; });  // NaN fails
  };
  return within(wish.linear_mps) && within(wish.angular_radps);
}

ManualController::ManualController(const ControllerConfig& config, TimeNs timeout_ns)
    : config_(config), timeout_ns_(std::min(timeout_ns, max_timeout_ns)), predictor_(of_yaw()) {}

bool ManualController::take(TimeNs came_ns, const Twist& wish) {
  if (!believable(wish)) return false;
  velocity_mps_ = wish.linear_mps;
  const double speed = std::hypot(velocity_mps_[0], velocity_mps_[1]);
  if (speed > config_.speed_mps) {
    velocity_mps_[0] *= config_.speed_mps / speed;
    velocity_mps_[1] *= config_.speed_mps / speed;
  }
  velocity_mps_[2] = std::clamp(velocity_mps_[2], -config_.max_vertical_mps, config_.max_vertical_mps);
  yaw_rate_radps_ = std::clamp(wish.angular_radps[2], -config_.max_yaw_rate_radps, config_.max_yaw_rate_radps);
  until_ns_ = came_ns + timeout_ns_;
  return true;
}

std::vector<Setpoint> ManualController::plan(std::uint64_t id, TimeNs now_ns, TimeNs first_ns) {
  const TimeNs wished_ns = std::clamp<TimeNs>(until_ns_ - now_ns, 0, timeout_ns_);
  std::vector<Setpoint> plan;
  motion::Predictor::Rollout rollout = predictor_.until(first_ns);
  for (TimeNs at_ns = 0; at_ns < horizon_ns;) {
    Setpoint setpoint;
    setpoint.at_ns = first_ns + at_ns;
    TimeNs next_ns = at_ns + step_ns;
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
    if (at_ns < wished_ns) {
      next_ns = std::min(next_ns, wished_ns);
      const Eigen::AngleAxisd heading(rollout.effect().yaw_rad, Eigen::Vector3d::UnitZ());
      velocity = heading * Eigen::Vector3d::Map(velocity_mps_.data());
      Eigen::Vector3f::Map(setpoint.velocity_mps.data()) = velocity.cast<float>();
      setpoint.yaw_rate_radps = static_cast<float>(yaw_rate_radps_);
    }
    plan.push_back(setpoint);
    rollout.tell(velocity, static_cast<double>(setpoint.yaw_rate_radps), rollout.told_until_ns() + next_ns - at_ns);
    at_ns = next_ns;
  }
  predictor_.sent(id, plan);
  return plan;
}

}  // namespace ledgerline::ground
