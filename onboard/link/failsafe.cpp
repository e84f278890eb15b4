#include "onboard/link/failsafe.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {
namespace {

bool older(TimeNs now, TimeNs stamp, TimeNs limit) noexcept { return stamp == 0 || now - stamp > limit; }

// What broke once must do better than just enough to be trusted again: so a pose or state that comes and goes does not
// make the mode come and go.
TimeNs tightened(TimeNs limit, const FailsafeState& last) noexcept {
  return last.mode == FailsafeMode::brake ? limit / 2 : limit;
}

// Poses come through agent, so its death takes them along: that is agent's silence, and the plan is still flown to its
// end. The pose alone is lost when agent has been heard for a while without one.
bool lost_pose(const FailsafeSettings& settings, const FailsafeState& last, TimeNs now,
               const FailsafeFacts& facts) noexcept {
  const TimeNs limit = tightened(settings.pose_lost_ns, last);
  return older(now, facts.pose_ns, limit) && facts.beat_ns - facts.pose_ns > limit / 2;
}

// How far outside the fence (0: inside), and the speed away from it.
struct Outside {
  double distance_m = 0;
  double outward_mps = 0;
};

Outside outside(const FenceSettings& fence, const FailsafeFacts& facts, bool pose_lost) noexcept {
  Outside worst;
  if (pose_lost) {  // the drone's own height is all there is
    if (facts.height_m > fence.max_m[2]) worst.distance_m = facts.height_m - fence.max_m[2];
    return worst;
  }
  for (std::size_t i = 0; i < 3; ++i) {
    // No ground under the ground: the lower face of the box holds setpoints only.
    const double below = i == 2 ? 0 : fence.min_m[i] - facts.position_m[i];
    const double above = facts.position_m[i] - fence.max_m[i];
    const double distance = std::max(below, above);
    if (distance > 0) {
      worst.distance_m = std::max(worst.distance_m, distance);
      worst.outward_mps = std::max(worst.outward_mps, above > 0 ? facts.velocity_mps[i] : -facts.velocity_mps[i]);
    }
  }
  return worst;
}

FailsafeState change(const FailsafeState& last, TimeNs now, FailsafeMode mode, FailsafeCause cause) noexcept {
  FailsafeState next = last;
  const bool hovers = mode == FailsafeMode::hold || mode == FailsafeMode::brake;
  next.hovering_since_ns = !hovers ? 0 : last.hovering_since_ns != 0 ? last.hovering_since_ns : now;
  next.cause_gone_since_ns = 0;
  next.mode = mode;
  next.cause = cause;
  return next;
}

// Causes that land at once, in their order of weight; none: there is none.
FailsafeCause landing_cause(const FailsafeSettings& settings, const FenceSettings& fence, FailsafeState& memory,
                            TimeNs now, const FailsafeFacts& facts, bool pose_lost) noexcept {
  if (facts.stop) return FailsafeCause::stopped;
  if (!older(now, facts.state_ns, settings.state_stale_ns) && facts.battery <= settings.battery_critical) {
    return FailsafeCause::battery_critical;
  }
  const Outside out = outside(fence, facts, pose_lost);
  const bool outward =
      out.distance_m > fence.far_beyond_m || (out.distance_m > 0 && (pose_lost || out.outward_mps > fence.outward_mps));
  if (!outward) {
    memory.outward_since_ns = 0;
  } else if (memory.outward_since_ns == 0) {
    memory.outward_since_ns = now;
  }
  if (outward && now - memory.outward_since_ns >= settings.fence_land_after_ns) return FailsafeCause::fence;
  return FailsafeCause::none;
}

// While flying: what keeps the plan from being flown, and how.
FailsafeState hover_or_fly(const FailsafeSettings& settings, const FenceSettings& fence, const FailsafeState& last,
                           TimeNs now, const FailsafeFacts& facts, bool pose_lost) noexcept {
  const bool state_stale = older(now, facts.state_ns, tightened(settings.state_stale_ns, last));
  if (state_stale || pose_lost) {
    return change(last, now, FailsafeMode::brake, state_stale ? FailsafeCause::state_stale : FailsafeCause::pose_lost);
  }
  if (last.mode == FailsafeMode::brake) {
    FailsafeState next = last;
    if (next.cause_gone_since_ns == 0) next.cause_gone_since_ns = now;
    if (now - next.cause_gone_since_ns < settings.clear_after_ns) return next;
    // The brake dropped the plans it met: without a new one this is a hold, and its clock goes on.
  }
  if (!facts.plan_valid) {
    const TimeNs since = std::max(facts.covered_until_ns, facts.flying_since_ns);
    const bool hovered = last.mode == FailsafeMode::hold || last.mode == FailsafeMode::brake;
    if (hovered || now - since >= settings.hold_grace_ns) {
      const bool agent_silent = older(now, facts.beat_ns, settings.agent_silent_ns);
      const FailsafeCause cause = agent_silent          ? FailsafeCause::agent_silent
                                  : !facts.ledger_alive ? FailsafeCause::ledger_silent
                                                        : FailsafeCause::plan_ran_out;
      return change(last, now, FailsafeMode::hold, cause);
    }
  }
  FailsafeCause warning = FailsafeCause::none;
  if (outside(fence, facts, false).distance_m > 0) {
    warning = FailsafeCause::fence;
  } else if (last.battery_low) {
    warning = FailsafeCause::battery_low;
  }
  return change(last, now, FailsafeMode::none, warning);
}

}  // namespace

FailsafeState update(const FailsafeSettings& settings, const FenceSettings& fence, const FailsafeState& last,
                     TimeNs now, const FailsafeFacts& facts) noexcept {
  FailsafeState memory = last;
  if (facts.state_ns != 0) {
    if (facts.battery <= settings.battery_low) memory.battery_low = true;
    if (facts.battery > settings.battery_low + settings.battery_margin) memory.battery_low = false;
  }
  if (!in_flight(facts.phase)) {
    FailsafeState grounded = change(memory, now, FailsafeMode::none, FailsafeCause::none);
    grounded.outward_since_ns = 0;
    grounded.cause = takeoff_refusal(settings, now, facts);
    if (grounded.cause == FailsafeCause::none && memory.battery_low) grounded.cause = FailsafeCause::battery_low;
    return grounded;
  }
  if (facts.cut) return change(memory, now, FailsafeMode::cut, FailsafeCause::stopped);
  if (memory.mode == FailsafeMode::land || memory.mode == FailsafeMode::cut)
    return memory;  // until it is on the ground

  const bool pose_lost = lost_pose(settings, memory, now, facts);
  const FailsafeCause cause = landing_cause(settings, fence, memory, now, facts, pose_lost);
  if (cause != FailsafeCause::none) return change(memory, now, FailsafeMode::land, cause);
  if (facts.phase != FlightPhase::flying) return change(memory, now, FailsafeMode::none, FailsafeCause::none);

  const FailsafeState next = hover_or_fly(settings, fence, memory, now, facts, pose_lost);
  if (next.hovering_since_ns != 0 && now - next.hovering_since_ns >= settings.land_after_ns) {
    // The cause stays readable: only a mere lack of plans becomes "held too long".
    return change(next, now, FailsafeMode::land,
                  next.cause == FailsafeCause::plan_ran_out ? FailsafeCause::held_too_long : next.cause);
  }
  return next;
}

FailsafeCause takeoff_refusal(const FailsafeSettings& settings, TimeNs now, const FailsafeFacts& facts) noexcept {
  if (facts.stop || facts.cut) return FailsafeCause::stopped;
  if (older(now, facts.state_ns, settings.state_stale_ns)) return FailsafeCause::state_stale;
  if (facts.battery <= settings.battery_low) return FailsafeCause::battery_low;
  if (older(now, facts.beat_ns, settings.agent_silent_ns)) return FailsafeCause::agent_silent;
  if (!facts.ledger_alive) return FailsafeCause::ledger_silent;
  if (older(now, facts.pose_ns, settings.pose_lost_ns)) return FailsafeCause::pose_lost;
  return FailsafeCause::none;
}

Velocity clip_at_fence(const FenceSettings& fence, const std::array<double, 3>& position_m, Velocity wish) noexcept {
  for (std::size_t i = 0; i < 3; ++i) {
    const double up = std::max(0.0, fence.max_m[i] - position_m[i]) / fence.slow_s;
    const double down = std::max(0.0, position_m[i] - fence.min_m[i]) / fence.slow_s;
    wish.mps[i] = std::clamp(wish.mps[i], static_cast<float>(-down), static_cast<float>(up));
  }
  return wish;
}

}  // namespace ledgerline::link
