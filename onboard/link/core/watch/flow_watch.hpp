#pragma once
#include "common/rt/clock.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// Whether a drone's own flow sees anything. In the dark, or over a floor that shows nothing, a Tello tells velocities of
/// exactly zero however it moves, and nothing else in its text says so. So zeros while it is told to move are no
/// velocity, until one that is not zero comes. A drone that is told to hover looks the same with and without sight. Core;
/// one thread.
class FlowWatch {
 public:
  /// Told to move: one and a half steps of the text, which a drone that moves so cannot tell as zero for long.
  static constexpr double moving_mps = 0.15;
  /// Ten texts: half is a start from rest, with double a drone that believes to stand gathers speed for a second more.
  static constexpr TimeNs blind_after_ns = 1 * ns_per_s;

  /// A state text in flight that came at `now`, of a drone that should move at `expected_mps` by what it was told.
  void take(TimeNs now, const TelloState& state, double expected_mps) noexcept;
  void reset() noexcept { *this = {}; }
  bool blind() const noexcept { return unseen_ns_ >= blind_after_ns; }

 private:
  TimeNs text_ns_ = 0, unseen_ns_ = 0;
};

}  // namespace ledgerline::link
