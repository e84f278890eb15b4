#include "onboard/link/core/playout/limiter.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {

void Limiter::reset(TimeNs now) noexcept {
  output_ = {};
  last_ns_ = now;
}

const Velocity& Limiter::step(TimeNs now, const Velocity& desired, bool braking) noexcept {
  // A long gap between two steps must not allow one big jump.
  const auto dt = static_cast<float>(std::clamp(to_seconds(now - last_ns_), 0.0, 0.05));
  last_ns_ = now;

  std::array<float, 3> goal = desired.mps;
  const float speed = std::hypot(goal[0], goal[1]);
  if (speed > settings_.max_speed_mps) {
    goal[0] *= settings_.max_speed_mps / speed;
    goal[1] *= settings_.max_speed_mps / speed;
  }
  goal[2] = std::clamp(goal[2], -settings_.max_vertical_mps, settings_.max_vertical_mps);

  std::array<float, 3> change{};
  for (std::size_t i = 0; i < 3; ++i) change[i] = goal[i] - output_.mps[i];
  const float wanted = std::hypot(change[0], change[1], change[2]);
  const float allowed = settings_.max_acceleration_mps2 * (braking ? 2.0F : 1.0F) * dt;
  if (wanted <= allowed) {
    output_.mps = goal;  // exactly: zero is reached, not approached
  } else {
    for (std::size_t i = 0; i < 3; ++i) output_.mps[i] += change[i] * allowed / wanted;
  }

  const float yaw = std::clamp(desired.yaw_radps, -settings_.max_yaw_rate_radps, settings_.max_yaw_rate_radps);
  const float yaw_change = settings_.max_yaw_acceleration_radps2 * dt;
  output_.yaw_radps += std::clamp(yaw - output_.yaw_radps, -yaw_change, yaw_change);
  return output_;
}

}  // namespace ledgerline::link
