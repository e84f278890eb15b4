#pragma once
#include <array>

#include "common/msg/onboard.hpp"

namespace ledgerline::link {

/// Whether a drone moves as it is told: what it was told goes through the drone's response (first order), what is seen
/// of it through the same filter, and the two must not differ for long. So a drone that hears another drone's rc, whose
/// poses are another drone's or turned against it, or whose own flow sees nothing, is found, whatever the cause. A heading
/// that is wrong from the start is found where poses come from elsewhere alone: a drone's own odometry turns with it.
/// Horizontal, map frame. Core; one thread.
class MotionWatch {
 public:
  /// Three times what gusts do (0.1 m/s): a flow that sees nothing is found from 0.35 m/s on. Double would miss the
  /// usual 0.5 m/s; half would land for a windy day.
  static constexpr double limit_mps = 0.3;
  /// Of what it was told: a fast drone is slower than it is told by its drag.
  static constexpr double limit_share = 0.6;
  /// A push from outside is over by then, and so is a jam of 3 s on the way to the drone. A turned frame has led
  /// it two metres away at 0.5 m/s: half would land for a jam of datagrams, double doubles the two metres.
  static constexpr TimeNs differs_for_ns = 4 * ns_per_s;

  /// Time passed since the last call: `told` all the while.
  void tell(double seconds, const std::array<float, 3>& told_mps) noexcept;
  /// A new pose came: its velocity.
  void see(TimeNs now, const std::array<double, 3>& velocity_mps) noexcept;
  /// It does not fly, or nothing is known.
  void reset() noexcept { *this = {}; }
  /// How fast it should move by now.
  double expected_mps() const noexcept;
  bool differs() const noexcept { return since_ns_ != 0 && seen_ns_ - since_ns_ >= differs_for_ns; }

 private:
  std::array<double, 2> expected_mps_{}, smooth_mps_{};
  TimeNs seen_ns_ = 0, since_ns_ = 0;
};

}  // namespace ledgerline::link
