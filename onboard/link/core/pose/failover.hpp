#pragma once
#include <Eigen/Core>

#include "common/msg/onboard.hpp"

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
  void heard(TimeNs now) noexcept { heard_ns_ = now; }
  /// It spoke once, and is missing now.
  bool missing(TimeNs now) const noexcept { return heard_ns_ != 0 && now - heard_ns_ > after_ns_; }

  /// The pose to publish when `source` says `pose`. `flies`: the drone is in the air.
  Pose to_publish(Source source, const Pose& pose, bool flies) noexcept;
  /// Whose pose was published last.
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

}  // namespace ledgerline::link
