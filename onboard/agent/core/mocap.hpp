#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <utility>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"
#include "common/rt/clock.hpp"

namespace ledgerline::agent {

/// One measurement of a motion capture system, in the map frame.
struct MocapPose {
  TimeNs stamp_ns = 0;  ///< of the measurement, on the drone host's clock
  std::array<double, 3> position_m{};
  double yaw_rad = 0;
};

struct FusionSettings {
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

  explicit Fusion(const FusionSettings& settings) : settings_(settings) {}

  /// The fused pose (drone number not set), or nothing where the measurement was rejected. `in_flight`: as far as
  /// anybody knows; what stands still may be measured so.
  std::optional<Pose> add(const MocapPose& measured, bool in_flight = false);
  const Counters& counters() const { return counters_; }

 private:
  void start(const MocapPose& measured);
  bool check_frozen(const MocapPose& measured);

  FusionSettings settings_;
  Counters counters_;
  bool started_ = false;
  int outliers_in_a_row_ = 0;
  std::optional<MocapPose> repeated_;  ///< the first measurement of this very place
  TimeNs stamp_ns_ = 0;
  std::array<double, 3> position_m_{}, velocity_mps_{};
  /// Covariance of (position, velocity); the same for all axes, since all see the same noise at the same times.
  double pp_ = 0, pv_ = 0, vv_ = 0;
};

/// Mocap stamps are real time, decisions are made on CLOCK_MONOTONIC: this turns one into the other, and accepts no
/// stamp that lies more than 20 ms in the future or 1 s in the past. None comes out as newer than its arrival: link
/// refuses poses of the future. Real time may jump (NTP, a person), be it by less than those bounds: so the clocks are
/// read for every pose, and a jump costs at most the poses that were in flight. One thread.
class MocapClock {
 public:
  static constexpr TimeNs max_delay_ns = 1 * ns_per_s;
  static constexpr TimeNs max_ahead_ns = 20 * ns_per_ms;
  using ReadOffset = std::function<TimeNs()>;

  /// `read`: real time minus CLOCK_MONOTONIC, now.
  explicit MocapClock(ReadOffset read) : read_(std::move(read)), offset_ns_(read_()) {}

  void refresh() { offset_ns_ = read_(); }
  TimeNs offset_ns() const { return offset_ns_; }

  static bool plausible(TimeNs stamp_ns, TimeNs arrived_ns) {
    return stamp_ns - arrived_ns <= max_ahead_ns && arrived_ns - stamp_ns <= max_delay_ns;
  }
  /// The stamp on CLOCK_MONOTONIC; nothing where it is not accepted.
  std::optional<TimeNs> stamp(TimeNs source_real_ns, TimeNs arrived_ns) {
    refresh();
    const TimeNs stamp_ns = source_real_ns - offset_ns_;
    if (!plausible(stamp_ns, arrived_ns)) return std::nullopt;
    return std::min(stamp_ns, arrived_ns);
  }

 private:
  ReadOffset read_;
  TimeNs offset_ns_;
};

/// A pose as it came from a mocap system.
struct MocapMessage {
  TimeNs source_real_ns = 0;  ///< its stamp, of the mocap computer's real-time clock
  TimeNs arrived_ns = 0;      ///< on this host's CLOCK_MONOTONIC
  std::array<double, 3> position_m{};
  std::array<double, 4> orientation{};  ///< x, y, z, w
};

/// Whether a mocap pose is accepted at all, before it is fused: its position is finite, its orientation a unit
/// quaternion, to 5 % of the squared norm (a message of zeros is none), and its stamp is one that MocapClock accepts.
/// Whether it fits the ones before it, or repeats them, is Fusion's to say. One thread.
class MocapIntake {
 public:
  /// `stamps_of_this_host`: false where the mocap computer's clock is not held to this one's: arrival counts.
  MocapIntake(MocapClock::ReadOffset read, bool stamps_of_this_host = true)
      : clock_(std::move(read)), stamps_of_this_host_(stamps_of_this_host) {}

  /// The pose on this host's clock; the error says what is wrong with it.
  Result<MocapPose> check(const MocapMessage& message);
  /// Of the numbers alone.
  static Status check_numbers(const std::array<double, 3>& position_m, const std::array<double, 4>& orientation);

  MocapClock& clock() { return clock_; }

 private:
  MocapClock clock_;
  bool stamps_of_this_host_;
};

}  // namespace ledgerline::agent
