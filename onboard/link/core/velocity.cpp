#include "onboard/link/core/velocity.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {

BodyCommand to_body(const RcSettings& settings, const Velocity& velocity, double yaw_rad) noexcept {
  const auto c = static_cast<float>(std::cos(yaw_rad));
  const auto s = static_cast<float>(std::sin(yaw_rad));
  const float forward = c * velocity.mps[0] + s * velocity.mps[1];
  const float left = -s * velocity.mps[0] + c * velocity.mps[1];
  const float up = velocity.mps[2];

  const float largest = std::max({std::abs(forward), std::abs(left), std::abs(up)});
  const float shorter = largest > settings.full_scale_mps ? settings.full_scale_mps / largest : 1.0F;
  const float yaw = std::clamp(velocity.yaw_radps, -settings.full_scale_radps, settings.full_scale_radps);

  const float per_mps = 100 * shorter / settings.full_scale_mps;
  const std::array<float, 4> channels{left * per_mps, forward * per_mps, up * per_mps,
                                      yaw * 100 / settings.full_scale_radps};
  BodyCommand command;
  for (std::size_t i = 0; i < 4; ++i) command.rc[i] = static_cast<int>(std::lround(settings.signs[i] * channels[i]));
  for (std::size_t i = 0; i < 3; ++i) command.sent.mps[i] = velocity.mps[i] * shorter;
  command.sent.yaw_radps = yaw;
  return command;
}

Velocity to_map(const Velocity& body, double yaw_rad) noexcept {
  const auto c = static_cast<float>(std::cos(yaw_rad));
  const auto s = static_cast<float>(std::sin(yaw_rad));
  return {{c * body.mps[0] - s * body.mps[1], s * body.mps[0] + c * body.mps[1], body.mps[2]}, body.yaw_radps};
}

}  // namespace ledgerline::link
