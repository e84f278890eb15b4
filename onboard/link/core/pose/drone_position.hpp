#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

#include "common/msg/onboard.hpp"
#include "onboard/link/core/pose/motion_watch.hpp"
#include "onboard/link/core/pose/odometry.hpp"
#include "onboard/link/core/pose/source_check.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// Joins two sources of one drone's position: motion capture, and onboard odometry while motion capture is missing. The
/// published position and heading never jump under the controller that uses them. The difference between the two at a
/// change is let in at correction_mps and 10 degrees a second, and until then is part of the variance. Where nobody can
/// have followed, on the ground or behind a gap without either, the new source counts at once.
///
/// Core: no I/O, no clock, no allocation; one thread.
class Failover {
 public:
  enum class Source { none, mocap, own };

  /// `after_ns`: no pose of motion capture has come for so long: it is missing.
  Failover(TimeNs after_ns, double correction_mps) noexcept : after_ns_(after_ns), correction_mps_(correction_mps) {}

  /// A pose of motion capture came that is not too old to fly by.
  void on_mocap(TimeNs now) noexcept { heard_ns_ = now; }
  /// It spoke once, and is missing now.
  bool is_missing(TimeNs now) const noexcept { return heard_ns_ != 0 && now - heard_ns_ > after_ns_; }

  /// The pose to publish when `source` says `pose`. `flies`: the drone is in the air.
  Pose to_publish(Source source, const Pose& pose, bool flies) noexcept;
  Source source() const noexcept { return source_; }

 private:
  TimeNs after_ns_;
  double correction_mps_;
  Source source_ = Source::none;
  TimeNs heard_ns_ = 0;
  Pose published_;
  Eigen::Vector3d ahead_m_ = Eigen::Vector3d::Zero();  ///< what is published, less what the source says
  double ahead_rad_ = 0;
};

/// Where a drone is and how it moves, by the source that its config names: motion capture, onboard odometry, or one in
/// place of the other. Holds the sources against each other and the drone's motion against what it was sent, and
/// carries the newest pose on by that. Core: no I/O, no clock, no allocation after construction; one thread.
class DronePosition {
 public:
  DronePosition(const DroneSettings& drone, const std::vector<PadSettings>& pads, TimeNs pose_lost_ns);

  /// A state text that came at `now`. `stands`: it is seen on the ground; `sent`: its newest command.
  void on_state(TimeNs now, const TelloState& state, LinkPhase phase, bool stands, const Velocity& sent) noexcept;
  /// Of motion capture; ignored where that is not the source.
  void on_pose(TimeNs now, const Pose& pose, bool flies) noexcept;
  void on_phase(LinkPhase phase) noexcept;
  /// Time passed while it was sent this: the fence needs a position without a pose, too (agent died).
  void dead_reckon(double seconds, const Velocity& sent) noexcept;
  /// The clock stood still for so long while time passed.
  void grow_older(TimeNs slept_ns) noexcept;

  /// The newest, by which fence and separation go; its stamp is 0 where there was none.
  const Pose& pose() const noexcept { return pose_; }
  /// The same for the drone's pilot: it never jumps.
  const Pose& published_pose() const noexcept { return published_pose_; }
  TimeNs pose_came_ns() const noexcept { return pose_came_ns_; }
  /// Of that pose, moved on by what was sent since.
  std::array<double, 3> position_m() const noexcept;
  /// The heading by which velocities of the map become rc.
  double yaw_rad(TimeNs now) const noexcept;

  bool is_by_odometry() const noexcept;
  bool is_fix_overdue() const noexcept { return source_ == PoseSource::pads && odometry_.is_overdue(); }
  /// Motion capture and its own velocity contradict each other: neither is used ...
  bool has_source_conflict() const noexcept {
    return source_check_.verdict() == SourceCheck::Verdict::differ || are_sources_unresolved();
  }
  /// ... and have for so long that nothing is left to fly by.
  bool are_sources_unresolved() const noexcept {
    return source_ == PoseSource::mocap && source_check_.verdict() == SourceCheck::Verdict::unresolved;
  }
  /// It does not move as it was sent, as far as is seen now.
  bool is_motion_suspected() const noexcept { return motion_watch_.is_suspected(); }
  bool does_motion_differ() const noexcept { return motion_watch_.differs(); }
  /// Since when its flow is suspected to see nothing and nothing else holds it; 0: it is not.
  TimeNs dark_since_ns(TimeNs now) const noexcept;

 private:
  void watch_flow(TimeNs now, const TelloState& state, bool flying, const Velocity& sent) noexcept;
  /// Holds motion capture against the odometry, which took this text.
  void check_sources(TimeNs now, const TelloState& state, bool flying) noexcept;
  void accept(TimeNs now, const Pose& pose, bool flies) noexcept;
  /// Since when its position comes from onboard odometry alone; 0: it does not.
  TimeNs alone_since_ns(TimeNs now) const noexcept;

  PoseSource source_;
  TimeNs pose_lost_ns_;
  bool velocity_known_;
  Odometry odometry_;  ///< the source of its pose, or what motion capture is checked against
  SourceCheck source_check_;
  Failover failover_;              ///< where odometry stands in for motion capture
  Pose mocap_pose_;                ///< the newest of motion capture
  std::vector<PadSettings> pads_;  ///< none where they are not the source
  MotionWatch motion_watch_;
  FlowWatch flow_watch_;
  Pose pose_, published_pose_;
  TimeNs pose_came_ns_ = 0;
  std::array<double, 3> moved_m_{};                       ///< since that pose, as far as what was sent tells
  double drone_yaw_rad_ = 0, drone_yaw_at_pose_rad_ = 0;  ///< the drone's own, newest and at that pose
};

}  // namespace ledgerline::link
