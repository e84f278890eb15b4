#pragma once
#include <Eigen/Core>
#include <algorithm>

#include "common/msg/onboard.hpp"

namespace ledgerline::link {

/// Joins two sources of one drone's place: motion capture, and the drone's own senses while poses of motion capture are
/// missing. The place and heading that are told never jump: what lies between the two at a change is let in at
/// correction_mps and correction_radps, and until then is part of the variance. On the ground it counts at once.
///
/// Core: no I/O, no clock, no allocation; one thread.
class Failover {
 public:
  /// `after_ns`: the newest pose of motion capture is older than this: the drone's own senses tell.
  Failover(TimeNs after_ns, double correction_mps) noexcept : after_ns_(after_ns), correction_mps_(correction_mps) {}

  /// Motion capture spoke of `stamp_ns`.
  void heard(TimeNs stamp_ns) noexcept { mocap_ns_ = std::max(mocap_ns_, stamp_ns); }
  /// It spoke once, and is missing now.
  bool missing(TimeNs now) const noexcept { return mocap_ns_ != 0 && now - mocap_ns_ > after_ns_; }

  /// What is told when motion capture says `pose`. `flies`: it is in the air.
  Pose by_mocap(const Pose& pose, bool flies) noexcept;
  /// What is told when the drone's own senses say `pose`.
  Pose by_own_senses(const Pose& pose, bool flies) noexcept;

 private:
  enum class Origin { none, mocap, own };
  Pose tell(Origin origin, const Pose& pose, bool flies) noexcept;

  TimeNs after_ns_;
  double correction_mps_;
  Origin origin_ = Origin::none;
  TimeNs mocap_ns_ = 0;  ///< stamp of its newest pose
  Pose told_;
  Eigen::Vector3d ahead_m_ = Eigen::Vector3d::Zero();  ///< what is told, less what the source says
  double ahead_rad_ = 0;
};

}  // namespace ledgerline::link
