#pragma once
#include <array>
#include <cstddef>

#include "onboard/link/core/settings.hpp"

namespace ledgerline::link {

/// How much later than they say setpoints are to be flown because plans come late, as an audio jitter buffer does: a
/// quantile of the lateness of the newest 256 plans, never negative. The margin moves to it slowly, so that the time of
/// playout never goes back: it rises by half a second a second, falls by a twentieth. Core: no allocation; one thread.
class Margin {
 public:
  explicit Margin(const PlayoutSettings& settings) noexcept : settings_(settings) {}
  /// A plan came, this long after the time of its first setpoint (negative: before it).
  void add(TimeNs now, TimeNs lateness_ns) noexcept;
  /// Moves on to `now`.
  TimeNs step(TimeNs now) noexcept;
  TimeNs value() const noexcept { return margin_ns_; }

 private:
  PlayoutSettings settings_;
  std::array<TimeNs, 256> lateness_ns_{};
  std::size_t count_ = 0;  ///< plans so far
  TimeNs target_ns_ = 0;
  TimeNs target_since_ns_ = 0;
  TimeNs margin_ns_ = 0;
  TimeNs last_ns_ = 0;
};

}  // namespace ledgerline::link
