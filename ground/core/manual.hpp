#pragma once
#include <array>
#include <vector>

#include "common/msg/onboard.hpp"
#include "common/msg/ros.hpp"
#include "ground/core/controller.hpp"

namespace ledgerline::ground {

/// Every number finite and within absurd_speed.
bool plausible(const Twist& command);
/// Plausible, and more than a stick at rest reports: a tenth of a limit. So much takes a drone off its path.
bool is_deliberate(const Twist& command, const ControllerConfig& limits);

/// A person flies: turns the velocity that was commanded last (geometry_msgs/msg/Twist in the drone's frame: x forward,
/// y left, z up, yaw counter-clockwise) into plans in that same frame, so that neither a position nor a heading is
/// needed. A command holds for `timeout_ns` and not a moment longer: every plan ends in zero, so that a pilot who falls
/// silent leaves a drone that hovers.
///
///     no command --set_velocity()--> flies it --timeout_ns after it came, or release()--> no command: zero
///
/// Two clocks come in and are never compared: of the ground, when commands come; of the drone, when setpoints are
/// flown. Deterministic; one thread.
class ManualController {
 public:
  static constexpr TimeNs step_ns = 50 * ns_per_ms;
  static constexpr TimeNs horizon_ns = 600 * ns_per_ms;      ///< of a plan
  static constexpr TimeNs max_timeout_ns = 500 * ns_per_ms;  ///< so that a plan always has its zero

  /// Of the config: speed, vertical speed and yaw rate as limits.
  ManualController(const ControllerConfig& config, TimeNs timeout_ns);

  /// A command that came at `came_ns`, the ground's clock. False, and nothing changes, when it is not plausible. Roll
  /// and pitch rates are left out.
  bool set_velocity(TimeNs came_ns, const Twist& command);
  void release() { until_ns_ = 0; }

  /// Setpoints from `first_ns` (the drone's clock) on, which stands for `now_ns` (the ground's).
  std::vector<Setpoint> plan(TimeNs now_ns, TimeNs first_ns) const;

 private:
  ControllerConfig config_;
  TimeNs timeout_ns_;
  std::array<double, 3> velocity_mps_{};  ///< the drone's frame
  double yaw_rate_radps_ = 0;
  TimeNs until_ns_ = 0;  ///< the ground's clock
};

}  // namespace ledgerline::ground
