#pragma once
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"
#include "onboard/link/core/velocity.hpp"

namespace ledgerline::link {

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
