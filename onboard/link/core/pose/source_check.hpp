#pragma once
#include <Eigen/Core>
#include <cstdint>

#include "common/msg/onboard.hpp"
#include "common/rt/fixed_vector.hpp"

namespace ledgerline::link {

/// What a drone's onboard sensors report with a state text.
struct OwnMotion {
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  ///< map frame
  double scale_sigma = 0;                                  ///< of that velocity
  double lag_s = 0, lag_sigma_s = 0;                       ///< it is late by that
  double height_m = 0;                                     ///< above where it took off
  double heading_rad = 0;                                  ///< as its text has it, counter-clockwise
  float barometer_m = 0;                                   ///< its noise distinguishes one text from the next
  bool usable = false;
  Eigen::Vector2d position_m = Eigen::Vector2d::Zero();  ///< by its odometry ...
  double sigma_m = 0;                                    ///< ... to so much
};

/// How far a drone has moved by its own velocity since it was first heard. Plain data.
struct OwnPath {
  Eigen::Vector2d position_m = Eigen::Vector2d::Zero(), velocity_mps = Eigen::Vector2d::Zero();
  /// The newest usable velocity as reported, plausible or not.
  Eigen::Vector2d unlikely_mps = Eigen::Vector2d::Zero();
  int unlikely = 0;                                    ///< implausible texts in a row that agree; 0: plausible
  Eigen::Vector2d pushed_m = Eigen::Vector2d::Zero();  ///< how far it flew if they are right
  double length_m = 0, unmeasured_s = 0;               ///< without a usable velocity
  double height_m = 0, heading_rad = 0;
  TimeNs text_ns = 0;

  void advance(TimeNs now, const OwnMotion& own) noexcept;
  /// Extrapolated to a moment soon behind the newest text.
  Eigen::Vector2d position_at(TimeNs now) const noexcept;
};

/// Whether the drone can have flown and turned to a pose from the last accepted one: by its own velocity, height and
/// heading since, and what those may have missed. A pose that fails is dropped: it belongs to another body, or the
/// frame jumped. Later poses are accepted once they fit again. On the ground every pose passes, since a drone may be
/// carried.
///
/// Core: no I/O, no clock, no allocation; one thread.
class PoseGate {
 public:
  bool accepts(const Pose& pose, const OwnPath& own, double scale_sigma, bool in_flight) noexcept;

 private:
  Pose last_;
  OwnPath own_;  ///< at that pose
};

/// Whether motion capture and a drone's own velocity report the same motion: over 1.8 s they may be apart by 0.15 m and
/// 15 % of the path. Which of them is wrong cannot be determined, so neither is used:
///
///          apart for three texts         for 2 s
///   agree ───────────────────────▶ differ ───────▶ unresolved
///     ▲      half as far apart       │                  │
///     └──────────────────────────────┘                  │ alike for 2 s, and at one place (where odometry flew on)
///     └─────────────────────────────────────────────────┘
///
/// Core: no I/O, no clock, no allocation; one thread.
class SourceCheck {
 public:
  enum class Verdict : std::uint8_t { agree, differ, unresolved };

  /// Longer than gusts, rounding (0.05 m/s) and a late text; a frame that creeps at 0.2 m/s is seen in it. Half misses
  /// that; double is half a metre off before the brake.
  static constexpr TimeNs window_ns = 1800 * ns_per_ms;
  /// As a hover with velocities cast to whole dm/s is. Half brakes such a drone, double lets a frame creep by 0.2 m/s.
  static constexpr double apart_m = 0.15;
  /// Of the path: 0.1 m/s in 0.7 m/s. Half brakes for a tof over a carpet; double misses a quarter of the speed.
  static constexpr double apart_share = 0.15;
  /// A glitch has left the window by then. Half lands for one; double hovers 2 s longer on nothing.
  static constexpr TimeNs unresolved_after_ns = 2 * ns_per_s;

  /// A pose older than that is not compared.
  explicit SourceCheck(TimeNs pose_lost_ns) : pose_lost_ns_(pose_lost_ns) {}

  /// A state text came at `now`. `pose`: the newest that its gate accepted.
  void on_state(TimeNs now, const OwnMotion& own, const Pose& pose, bool flying) noexcept;
  /// A pose of motion capture came: whether it is one (PoseGate).
  bool accepts(const Pose& pose, bool in_flight) noexcept;

  Verdict verdict() const noexcept { return verdict_; }
  /// How far they are apart, or were in this flight [m].
  double off_m() const noexcept { return off_m_; }

 private:
  struct Sample {
    TimeNs at_ns = 0;
    Eigen::Vector2d posed_m, own_m, velocity_mps;
    double length_m = 0;
  };
  /// Apart by how much of what is allowed (1: at the limit); nothing to compare: 0.
  double compared(const Sample& newest, const OwnMotion& own) noexcept;
  void decide(TimeNs now, double share, const OwnMotion& own, const Pose& pose) noexcept;
  void forget() noexcept;

  TimeNs pose_lost_ns_;
  OwnPath path_;
  PoseGate gate_;
  double scale_sigma_ = 0;
  FixedVector<Sample, 32> samples_;
  int texts_apart_ = 0, texts_alike_ = 0, texts_unusable_ = 0, texts_repeated_ = 0;
  float barometer_m_ = 0;
  Verdict verdict_ = Verdict::agree;
  TimeNs differs_since_ns_ = 0, alike_since_ns_ = 0;
  double apart_now_m_ = 0, off_m_ = 0;
};

}  // namespace ledgerline::link
