#pragma once
#include <array>

#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// A velocity, of the map frame unless said otherwise, and a yaw rate, counter-clockwise.
struct Velocity {
  std::array<float, 3> mps{};
  float yaw_radps = 0;
};

/// The rc command for a velocity, and the velocity that it really means once every channel is within its range.
struct BodyCommand {
  Rc rc{};
  Velocity sent;  ///< map frame
};

/// From the map frame (ENU) into the drone's (REP 103: x forward, y left, z up) by its yaw, then to rc's channels. A
/// velocity beyond rc's range is made shorter, its direction kept.
BodyCommand to_body(const RcSettings& settings, const Velocity& velocity, double yaw_rad) noexcept;

/// From the drone's frame into the map's.
Velocity to_map(const Velocity& body, double yaw_rad) noexcept;

}  // namespace ledgerline::link
