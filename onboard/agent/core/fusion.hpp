#pragma once
#include <array>
#include <cstdint>
#include <optional>

#include "common/msg/onboard.hpp"

namespace ledgerline::agent {

/// One measurement of a motion capture system, in the map frame.
struct MocapPose {
  TimeNs stamp_ns = 0;  ///< of the measurement, on the drone host's clock
  std::array<double, 3> position_m{};
  double yaw_rad = 0;
};

struct FusionConfig {
  double position_sigma_m = 0.005;       ///< of a measurement
  double acceleration_sigma_mps2 = 4.0;  ///< how much the velocity may change by itself (white acceleration)
  double gate_sigma = 6.0;               ///< a measurement further off than this is an outlier
  int outliers_before_reset = 5;         ///< so many in a row are the truth, and the filter restarts
  TimeNs max_gap_ns = 300 * ns_per_ms;   ///< after a longer pause the filter restarts
  /// Nothing that flies is measured at one place to the last bit: a mocap system that says so for this long repeats
  /// what it saw last. Its own noise changes the bits from one measurement to the next; some measure more seldom than
  /// they send.
  TimeNs frozen_after_ns = 100 * ns_per_ms;
};

/// Mocap positions to position and velocity: a Kalman filter with constant velocity per axis (Bar-Shalom, Estimation
/// with Applications, 6.3.2: discretised white-noise acceleration). Yaw is passed on as measured. The pose keeps the
/// measurement's stamp. Rejects what is not finite, not newer than the last one, an outlier, or repeated in flight. One
/// thread; deterministic.
class Fusion {
 public:
  struct Counters {
    std::uint64_t accepted = 0, not_finite = 0, not_newer = 0, outliers = 0, frozen = 0, resets = 0;
  };

  explicit Fusion(const FusionConfig& config) : config_(config) {}

  /// The fused pose (drone number not set), or nothing where the measurement was rejected. `in_flight`: as far as
  /// anybody knows; what stands still may be measured so.
  std::optional<Pose> add(const MocapPose& measured, bool in_flight = false);
  const Counters& counters() const { return counters_; }

 private:
  void start(const MocapPose& measured);
  bool frozen(const MocapPose& measured);

  FusionConfig config_;
  Counters counters_;
  bool started_ = false;
  int outliers_in_a_row_ = 0;
  std::optional<MocapPose> repeated_;  ///< the first measurement of this very place
  TimeNs stamp_ns_ = 0;
  std::array<double, 3> position_m_{}, velocity_mps_{};
  /// Covariance of (position, velocity); the same for all axes, since all see the same noise at the same times.
  double pp_ = 0, pv_ = 0, vv_ = 0;
};

}  // namespace ledgerline::agent
