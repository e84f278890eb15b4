#pragma once
#include "common/msg/onboard.hpp"

namespace ledgerline::link {

/// What share of its battery a drone needs to land from where it is, by how fast it has emptied recently. A Tello
/// reports whole percents, so the rate is taken over seconds. Core; one thread.
class BatteryWatch {
 public:
  /// Kept for behind the landing: at 5 % a Tello lands by itself, or falls.
  static constexpr double reserve = 0.05;
  static constexpr double landing_mps = 0.5;    ///< as a Tello sinks (docs/sources.md)
  static constexpr double landing_takes_s = 2;  ///< besides: until it begins, and the last centimetres
  /// Long enough for several steps of a percent where it matters; a full battery loses one in eight seconds.
  static constexpr TimeNs window_ns = 10 * ns_per_s;

  /// A state text in flight that came at `now`.
  void take(TimeNs now, float battery) noexcept;
  void reset() noexcept { *this = {}; }
  double rate_per_s() const noexcept { return rate_per_s_; }
  /// Share of a full battery below which it must land now, from `height_m`.
  double needed(float height_m) const noexcept;

 private:
  TimeNs since_ns_ = 0;
  float at_since_ = 0, newest_ = 0;
  double rate_per_s_ = 0;
};

}  // namespace ledgerline::link
