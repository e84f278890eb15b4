#pragma once
#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/velocity.hpp"

namespace ledgerline::link {

/// Keeps a velocity within speed and acceleration limits: each call moves the output toward the desired, no faster than
/// allowed. Core: no allocation; one thread.
class Limiter {
 public:
  explicit Limiter(const PlayoutSettings& settings) noexcept : settings_(settings) {}
  /// `braking` doubles the acceleration allowed: for failsafe brakes only.
  const Velocity& step(TimeNs now, const Velocity& desired, bool braking) noexcept;
  const Velocity& output() const noexcept { return output_; }
  /// The drone is known to stand still (on the ground, or right after take-off).
  void reset(TimeNs now) noexcept;

 private:
  PlayoutSettings settings_;
  Velocity output_;
  TimeNs last_ns_ = 0;
};

}  // namespace ledgerline::link
