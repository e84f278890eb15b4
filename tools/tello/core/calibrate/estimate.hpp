#pragma once
#include <array>
#include <optional>
#include <string>

#include "common/base/result.hpp"
#include "tools/tello/core/calibrate/record.hpp"
#include "tools/tello/core/calibrate/velocity.hpp"

namespace ledgerline::tello {

/// How one kind of motion answers rc: rc 100 means `full_scale` (m/s, rad/s) ...
struct Answering {
  Estimate full_scale;
  Estimate lag_s, dead_s;  ///< ... by a first order with dead time (fit.hpp)
};

/// What a calibration flight shows. Frames are REP 103's: forward, left, up, counter-clockwise. Standard deviations are
/// by the spread among the blocks of the flight; what is the same in all of them (the scale of a drone's own flow,
/// without poses) is not in them.
struct Calibration {
  Answering along, up, turning;         ///< forward and left together; up and down; yaw
  std::array<int, 4> rc_signs{};        ///< 1 or -1: rc a, b, c, d against left, forward, up, counter-clockwise
  std::array<int, 3> velocity_signs{};  ///< vgx, vgy, vgz against forward, left, up
  bool velocity_in_body = false;        ///< they turn with the drone; else they are reported in the frame at power on
  bool poses = false;                   ///< velocities are of the pose source; else the drone's own
  /// What vgx and vgy are worth; or why that is not seen. What was sent is no reference: a drone flies by its own flow.
  Result<VelocityFit> velocity = Error{"without poses nothing says how far it really flew"};
  /// With poses: where the nose is in the pose's own frame (counter-clockwise from the x of its orientation), and where
  /// it was in the source's frame at power on [rad].
  std::optional<Estimate> nose_rad, power_on_rad;
};

/// Senses that a frame does not know by itself are taken from the drone's own data, reported with it: forward and
/// left by its tilt (the nose goes down while it speeds up forward), up by height, counter-clockwise by its yaw, or by
/// the poses, where there are any. Fails, in words, where the flight does not show something. Core; takes seconds.
Result<Calibration> estimate(const Record& record);

/// As TOML: [rc] and [pose] for link.toml, [flight] for ground's, each key with how well it is known.
std::string toml(const Calibration& calibration);

}  // namespace ledgerline::tello
