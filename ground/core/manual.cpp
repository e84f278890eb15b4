#include "ground/core/manual.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::ground {

bool plausible(const Twist& command) {
  const auto within = [](const std::array<double, 3>& values) {
    return std::ranges::all_of(values, [](double v) { return std::abs(v) <= absurd_speed; });  // NaN fails
  };
  return within(command.linear_mps) && within(command.angular_radps);
}

bool is_deliberate(const Twist& command, const ControllerConfig& limits) {
  constexpr double at_rest = 0.1;
  const auto& [x, y, z] = command.linear_mps;
  return plausible(command) &&
         (std::hypot(x, y) > at_rest * limits.speed_mps || std::abs(z) > at_rest * limits.max_vertical_mps ||
          std::abs(command.angular_radps[2]) > at_rest * limits.max_yaw_rate_radps);
}

ManualController::ManualController(const ControllerConfig& config, TimeNs timeout_ns)
    : config_(config), timeout_ns_(std::min(timeout_ns, max_timeout_ns)) {}

bool ManualController::set_velocity(TimeNs came_ns, const Twist& command) {
  if (!plausible(command)) return false;
  velocity_mps_ = command.linear_mps;
  const double speed = std::hypot(velocity_mps_[0], velocity_mps_[1]);
  if (speed > config_.speed_mps) {
    velocity_mps_[0] *= config_.speed_mps / speed;
    velocity_mps_[1] *= config_.speed_mps / speed;
  }
  velocity_mps_[2] = std::clamp(velocity_mps_[2], -config_.max_vertical_mps, config_.max_vertical_mps);
  yaw_rate_radps_ = std::clamp(command.angular_radps[2], -config_.max_yaw_rate_radps, config_.max_yaw_rate_radps);
  until_ns_ = came_ns + timeout_ns_;
  return true;
}

std::vector<Setpoint> ManualController::plan(TimeNs now_ns, TimeNs first_ns) const {
  const TimeNs left_ns = std::clamp<TimeNs>(until_ns_ - now_ns, 0, timeout_ns_);
  std::vector<Setpoint> plan;
  for (TimeNs at_ns = 0; at_ns < horizon_ns;) {
    Setpoint setpoint;
    setpoint.at_ns = first_ns + at_ns;
    TimeNs next_ns = at_ns + step_ns;
    if (at_ns < left_ns) {
      next_ns = std::min(next_ns, left_ns);
      for (std::size_t i = 0; i < 3; ++i) setpoint.velocity_mps[i] = static_cast<float>(velocity_mps_[i]);
      setpoint.yaw_rate_radps = static_cast<float>(yaw_rate_radps_);
    }
    plan.push_back(setpoint);
    at_ns = next_ns;
  }
  return plan;
}

}  // namespace ledgerline::ground
