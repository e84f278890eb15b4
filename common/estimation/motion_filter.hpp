#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "common/msg/onboard.hpp"

/// Where a drone is and will be, by its poses and by what it was sent: for ground, which plans, and for link, which
/// holds the drone to its plan.
namespace ledgerline::estimation {

/// Position, velocity and yaw of a drone at a moment of its clock; map frame.
struct Motion {
  TimeNs stamp_ns = 0;
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
  double yaw_rad = 0;
};

/// What link sent a drone, from that moment on.
struct SentVelocity {
  TimeNs stamp_ns = 0;
  Eigen::Vector3d velocity_mps = Eigen::Vector3d::Zero();
  double yaw_rate_radps = 0;
};

/// Steps of the model's integration.
inline constexpr TimeNs cell_ns = 10 * ns_per_ms;

/// The model, running ahead of time. The motion is always one dead time ahead of the last velocity given: nothing sent
/// later can change it.
class Rollout {
 public:
  const Motion& effect() const { return motion_; }  ///< its stamp: sent_until_ns() + dead time
  TimeNs sent_until_ns() const { return sent_ns_; }
  const Eigen::Vector3d& sent_mps() const { return sent_; }
  /// The drone is sent this velocity until then, changed no faster than that.
  void send(const Eigen::Vector3d& velocity_mps, double yaw_rate_radps, TimeNs until_ns, double acceleration_mps2);

 private:
  friend class MotionFilter;
  void move(const Eigen::Vector3d& sent, double dt_s);
  Response response_;
  Eigen::Vector3d drift_ = Eigen::Vector3d::Zero();
  TimeNs sent_ns_ = 0;
  Eigen::Vector3d sent_ = Eigen::Vector3d::Zero();
  Motion motion_;
};

/// A Kalman filter for each axis has position, velocity and drift (what the wind adds to the velocity, slowly
/// changing), driven by what the drone was sent, through its Response (Bar-Shalom, Li, Kirubarajan: Estimation with
/// Applications to Tracking and Navigation, 5.2 and 6.2). Horizontal axes and height share one response; yaw is as
/// measured.
///
/// Deterministic; no allocation; one thread.
class MotionFilter {
 public:
  explicit MotionFilter(const Response& response) : response_(response) {}

  void set_response(const Response& response) { response_ = response; }
  const Response& response() const { return response_; }

  /// Times must grow: false, and ignored, where it is not newer. The newest 512 are kept: 2.5 s of 200 a second.
  bool add_sent(const SentVelocity& sent);
  /// A pose that is newer than newest(). True: the filter restarted, since the last one is more than 1 s old or more
  /// than 0.5 m from where it was expected.
  bool add_pose(const Motion& measured);

  bool ready() const { return motion_.stamp_ns > 0; }
  /// The newest pose as filtered; stamp 0: there was none.
  const Motion& newest() const { return motion_; }
  const Eigen::Vector3d& drift_mps() const { return drift_; }
  /// Between two moments the line between them: a step somewhere between is half a period off at most, and as often
  /// early as late. Before the first and behind the last it is theirs.
  SentVelocity sent_at(TimeNs t_ns) const;
  TimeNs newest_sent_ns() const { return count_ == 0 ? 0 : sent_back().stamp_ns; }
  bool has_sent() const { return count_ != 0; }
  /// From the newest pose on, with what was sent until then.
  Rollout rollout(TimeNs until_ns) const;

 private:
  static constexpr std::size_t kept = 512;
  const SentVelocity& sent_item(std::size_t i) const { return sent_[(first_ + i) % kept]; }
  const SentVelocity& sent_back() const { return sent_item(count_ - 1); }
  void start(const Motion& measured);
  void propagate(TimeNs to_ns);
  void correct(const Motion& measured);

  Response response_;
  std::array<SentVelocity, kept> sent_;  ///< a ring, oldest at first_
  std::size_t first_ = 0, count_ = 0;
  Motion motion_;
  Eigen::Vector3d drift_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance_ = Eigen::Matrix3d::Zero();  ///< of each axis: all see the same noise at the same times
};

}  // namespace ledgerline::estimation
