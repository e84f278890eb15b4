#pragma once
#include "common/rt/clock.hpp"
#include "onboard/link/core/failsafe.hpp"

namespace ledgerline::link {

/// A landing of a flying drone that is asked for, by its holder or by the failsafe, and not begun yet because another
/// drone is below it (docs/failsafe.md, FS-64).
///
///   none ──ask()──▶ asked ──nobody below, or !waits()──▶ the session lands it ──another phase: reset()──▶ none
///
/// The first request starts the time; repeating it, or another reason to land, does not start it again. One thread.
class LandingWait {
 public:
  /// `max_wait_ns`: SeparationSettings::landing_wait_s.
  explicit LandingWait(TimeNs max_wait_ns) noexcept : max_wait_ns_(max_wait_ns) {}

  void ask(TimeNs now) noexcept {
    if (asked_ns_ == 0) asked_ns_ = now;
  }
  void reset() noexcept { asked_ns_ = 0; }
  bool asked() const noexcept { return asked_ns_ != 0; }
  bool in_time(TimeNs now) const noexcept { return now - asked_ns_ < max_wait_ns_; }

 private:
  TimeNs max_wait_ns_;
  TimeNs asked_ns_ = 0;
};

/// Whether a drone that is to land can still be steered to a place with room below: its position is known, it does as
/// commanded, and nobody asked for it to be down at once. A brake has no usable position or state text.
inline bool can_wait_to_land(const FailsafeState& failsafe, const FailsafeFacts& facts) noexcept {
  if (failsafe.mode != FailsafeMode::none && failsafe.mode != FailsafeMode::land) return false;
  const bool lost = failsafe.cause == FailsafeCause::pose_lost || failsafe.cause == FailsafeCause::velocity_lost ||
                    failsafe.cause == FailsafeCause::height_lost || failsafe.cause == FailsafeCause::sources_differ;
  return !facts.stop && !facts.cut && !facts.tilted && !facts.overturned && !facts.motion_differs && !lost;
}

}  // namespace ledgerline::link
