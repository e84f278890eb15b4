#pragma once
#include <Eigen/Core>
#include <array>

#include "common/msg/onboard.hpp"
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// A fix far off what a filter expects may be right: it is accepted when so many in a row agree with each other.
class FixAgreement {
 public:
  explicit FixAgreement(int needed) noexcept : needed_(needed) {}
  void reset() noexcept { count_ = 0; }
  /// One more that is off by so much; two agree where they are no further apart than `spread`.
  bool holds(const Eigen::Vector2d& off, double spread) noexcept;

 private:
  int needed_, count_ = 0;
  Eigen::Vector2d off_ = Eigen::Vector2d::Zero();
};

/// The position of a drone by onboard odometry: velocities from its optical flow, yaw, height above what is below it
/// (tof), above where it took off (h) and by air pressure, fused by two Kalman filters (Bar-Shalom, Estimation with
/// Applications, 5.2), one of the plane and one of the height. Its place is known where it starts, and less with each
/// metre and second: the pose's variance says how well. Absolute fixes (a mission pad, motion capture before it went
/// away) bring it back.
///
/// The reported position never jumps: what a fix corrects is let in at OdometrySettings::correction_mps, and until
/// then is part of the variance. A fix that is far beyond what the variance allows is accepted when three in a row
/// agree, a heading when fifty do: the filter's own is a gyroscope's.
///
///   plane:  x, y | slow error of the flow in x, y | its scale | heading of the frame that velocities are reported in
///   height: z | height of what is below | drift of h | zero of the barometer
///
/// Core: no I/O, no clock, no allocation; one thread.
class Odometry {
 public:
  explicit Odometry(const OdometrySettings& settings) noexcept;

  /// A state text that came at `now`. `stands`: it is seen on the ground, so it does not move. It is where the settings
  /// say when it is first seen standing, and when it was switched off and on; first seen in the air (a link that starts
  /// again), or standing where it was seen flying before a silence, it may be anywhere.
  void on_state(TimeNs now, const TelloState& state, bool stands) noexcept;
  /// The clock stood still for so long while the drone went on: the next text counts as so much later.
  void grow_older(TimeNs slept_ns) noexcept {
    if (text_ns_ != 0) text_ns_ -= slept_ns;
  }
  /// An absolute fix at the time of the newest text: place and heading in the map, with their standard deviations.
  struct Fix {
    std::array<double, 3> position_m{};
    double sigma_m = 0;
    double yaw_rad = 0, sigma_rad = 0;
  };
  void fix(const Fix& fix) noexcept;
  /// Something says that it may be off by so much more.
  void widen(double metres) noexcept;

  /// Newest velocity in the map, by the scale and heading that fixes have shown, but with the flow's slow error in it:
  /// what else is checked against must not have been corrected by it.
  Eigen::Vector2d velocity_mps() const noexcept;
  double scale_sigma() const noexcept;
  const OdometrySettings& settings() const noexcept { return settings_; }
  /// It has flown for too long, or too far, since its position was last known by more than onboard odometry.
  bool is_overdue() const noexcept {
    return last_fix_.flown_s > settings_.max_unfixed_s || last_fix_.flown_m > settings_.max_unfixed_m;
  }

  /// Map frame. Its stamp is that of the newest text with usable velocities; 0: there was none.
  const Pose& pose() const noexcept { return pose_; }

 private:
  using Plane = Eigen::Matrix<double, 6, 1>;
  using PlaneMatrix = Eigen::Matrix<double, 6, 6>;
  using Height = Eigen::Vector4d;
  using HeightMatrix = Eigen::Matrix4d;

  void start(const TelloState& state, bool at_start) noexcept;
  bool heading_fits(const Fix& fix) noexcept;
  /// What it moved in the map since the newest fix, which the lag of its velocities makes late.
  Eigen::Vector2d speed_change() const noexcept;
  /// Position in x and y, corrected for the velocity lag.
  Eigen::Vector2d place() const noexcept;
  /// How far a fix is beside the place in x and y, and the variance of that.
  Eigen::Vector2d beside(const Fix& fix) const noexcept;
  Eigen::Matrix2d place_variance(const Fix& fix) const noexcept;
  void fix_heading(const Fix& fix) noexcept;
  void predict(double seconds, const Eigen::Vector3d& velocity_mps, bool stands) noexcept;
  void measure_height(const TelloState& state) noexcept;
  void update_height(const Height& by, double measured, double sigma) noexcept;
  Eigen::Vector3d reported_velocity(const TelloState& state) const noexcept;
  Eigen::Vector3d in_map(const Eigen::Vector3d& velocity_mps) const noexcept;
  double yaw() const noexcept;
  void update_pose(const Eigen::Vector3d& velocity_mps) noexcept;

  OdometrySettings settings_;
  Plane plane_ = Plane::Zero();
  PlaneMatrix plane_cov_ = PlaneMatrix::Zero();
  Height height_ = Height::Zero();
  HeightMatrix height_cov_ = HeightMatrix::Zero();
  double frame_yaw_rad_ = 0;  ///< of the frame at power on, in the map
  double drone_yaw_rad_ = 0;  ///< the newest, counter-clockwise since power on
  double takeoff_z_m_ = 0;    ///< h is 0 there
  int motor_s_ = 0;           ///< grows while it is switched on
  bool placed_ = false;       ///< it was seen standing at its start, or has been fixed
  bool stood_ = false;        ///< at the newest text
  double unmeasured_m_ = 0;   ///< how far it may have gone since its velocity was usable
  FixAgreement refused_positions_, refused_headings_;
  struct {
    Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  ///< then
    double flown_s = 0, flown_m = 0;                         ///< since
  } last_fix_;                                               ///< when its place was known last
  TimeNs text_ns_ = 0;                                       ///< the newest text
  Eigen::Vector3d last_velocity_mps_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d held_back_m_ = Eigen::Vector3d::Zero();  ///< of corrections, not yet reported
  Pose pose_;
};

}  // namespace ledgerline::link
