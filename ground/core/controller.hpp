#pragma once
#include <limits>
#include <vector>

#include "ground/core/path.hpp"
#include "ground/core/prediction.hpp"

namespace ledgerline::ground {

struct ControllerConfig {
  double speed_mps = 0.5;
  double height_m = 1.0;
  double lag_s = 0.3;              ///< of the drone's answer to a velocity setpoint, first order
  double acceleration_mps2 = 1.0;  ///< of the reference along the path
  double corner_speed_mps = 0.2;   ///< through a turn of 90 degrees; less for sharper turns
  double position_gain = 2.0;      ///< 1/s; with the lag: damped nearly critically by velocity_gain
  double velocity_gain = 0.4;
  double height_gain = 1.0;  ///< 1/s
  double yaw_gain = 1.0;     ///< 1/s
  double max_vertical_mps = 0.5;
  double max_yaw_rate_radps = 0.7;
  double leash_m = 0.4;  ///< the reference stops when it is this far ahead of the drone
};

/// Follows a path: a reference point moves along it (slower at corners, waiting when the drone falls behind), and the
/// drone is steered to the reference by velocity setpoints: the reference's velocity, led by the drone's lag, plus
/// corrections of position and velocity. Each plan starts from the state predicted for the moment when its first
/// setpoint is meant to be flown, by a first-order lag under the setpoints already sent. The work of a plan is bounded,
/// whatever the times in the state: after a pause of more than 3 s the reference goes on from where it was, as it would
/// after 3 s. Deterministic; one thread.
class PathController {
 public:
  static constexpr TimeNs step_ns = 50 * ns_per_ms;
  static constexpr std::size_t steps = 12;  // 0.6 s

  PathController(Path path, ControllerConfig config, double yaw_rad);

  /// Lets the reference move from `from_ns` on, as far as `end_m` along the path (laps count on); until then it waits
  /// at the origin.
  void start(TimeNs from_ns, double end_m = std::numeric_limits<double>::infinity());
  /// Setpoints for first_ns, first_ns + 50 ms, ...; first_ns must not go back from plan to plan.
  std::vector<Setpoint> plan(const Motion& state, TimeNs first_ns);

  /// Of the reference, over all laps.
  double progress_m() const { return progress_m_; }
  bool at_end() const { return started_ && progress_m_ >= end_m_; }
  const Path& path() const { return path_; }
  const Eigen::Vector3d& predicted_m() const { return predicted_.position_m; }

 private:
  double speed_at(double s_m) const;
  double pace(double s_m, const Eigen::Vector2d& drone) const;
  double advance(double s_m, const Eigen::Vector2d& drone, double dt_s) const;
  Setpoint steer(const Motion& from, double s_m) const;

  Path path_;
  ControllerConfig config_;
  double yaw_rad_;
  bool started_ = false;
  double end_m_ = 0;
  TimeNs reference_ns_ = 0;  ///< the moment that progress_m_ belongs to
  double progress_m_ = 0;
  Prediction prediction_;
  Motion predicted_;
};

}  // namespace ledgerline::ground
