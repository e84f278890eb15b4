#pragma once
#include "common/rt/clock.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// Whether a drone in the air is tilted beyond what flying needs, and whether it lies on its back or side: then its
/// motors only do harm. The two are distinguished by gravity: a flying drone's accelerometer feels its thrust, along
/// its own up, however it is tilted; a lying one feels the ground's push, which is not. Core; one thread.
class TiltWatch {
 public:
  /// A Tello tilts by 0.5 rad at most when it is flown hard, and its own controller gives up near 1.2.
  static constexpr double tilted_rad = 1.05;
  /// Three texts: one alone may be a knock.
  static constexpr TimeNs tilted_for_ns = 200 * ns_per_ms;
  static constexpr TimeNs overturned_for_ns = 1 * ns_per_s;
  /// On the ground: a drone on a slope or on something does not rise straight. About 17 degrees.
  static constexpr double no_takeoff_rad = 0.3;

  /// A state text that came at `now`.
  void take(TimeNs now, const TelloState& state) noexcept;
  double tilt_rad() const noexcept { return tilt_rad_; }
  bool tilted() const noexcept { return tilted_since_ns_ != 0 && text_ns_ - tilted_since_ns_ >= tilted_for_ns; }
  bool overturned() const noexcept { return lies_since_ns_ != 0 && text_ns_ - lies_since_ns_ >= overturned_for_ns; }

 private:
  double tilt_rad_ = 0;
  TimeNs text_ns_ = 0, tilted_since_ns_ = 0, lies_since_ns_ = 0;
};

}  // namespace ledgerline::link
