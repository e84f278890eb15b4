#include "onboard/link/core/failsafe.hpp"

#include <algorithm>

#include "common/rt/since.hpp"
#include "onboard/link/core/drone_watches.hpp"

namespace ledgerline::link {
namespace {

bool older(TimeNs now, TimeNs stamp, TimeNs limit) noexcept { return stamp == 0 || now - stamp > limit; }

// What broke once must do better to be accepted again: so a pose that comes and goes does not make the mode do so.
TimeNs tightened(TimeNs limit, const FailsafeState& last) noexcept {
  return last.mode == FailsafeMode::brake ? limit / 2 : limit;
}

// Poses of motion capture come through agent, so its death takes them along: that is agent's silence, and the plan is
// still flown to its end. The pose alone is lost when agent has been heard for a while without one.
bool lost_pose(const FailsafeSettings& settings, const FailsafeState& last, TimeNs now,
               const FailsafeInputs& inputs) noexcept {
  const TimeNs limit = tightened(pose_limit_ns(settings, inputs.by_odometry), last);
  if (inputs.by_odometry) return older(now, inputs.pose_ns, limit);
  return older(now, inputs.pose_ns, limit) && inputs.heartbeat_ns - inputs.pose_ns > limit / 2;
}

// `h` comes in steps of 0.1 m. A drone counts as above the ceiling by what is surely so, a step and a rounding less
// than `h` says: else one that flies just below it would be warned, and with an upward speed landed, by the step alone.
constexpr double height_step_m = 0.15;

// How far outside the fence (0: inside), and the speed away from it.
struct Outside {
  double distance_m = 0;
  double outward_mps = 0;
};

Outside outside(const FenceSettings& fence, const FailsafeInputs& inputs, bool pose_lost) noexcept {
  Outside worst;
  if (pose_lost) {  // the drone's own height is all there is
    if (inputs.height_m > fence.max_m[2]) worst.distance_m = inputs.height_m - fence.max_m[2];
    return worst;
  }
  for (std::size_t i = 0; i < 3; ++i) {
    // No ground under the ground: the lower face of the box holds setpoints only.
    const double below = i == 2 ? 0 : fence.min_m[i] - inputs.position_m[i];
    // The ceiling is held by the higher one of pose and the drone's own height: either may be wrong.
    const double place =
        i == 2 ? std::max(inputs.position_m[i], double(inputs.height_m) - height_step_m) : inputs.position_m[i];
    const double above = place - fence.max_m[i];
    const double distance = std::max(below, above);
    if (distance > 0) {
      worst.distance_m = std::max(worst.distance_m, distance);
      worst.outward_mps = std::max(worst.outward_mps, above > 0 ? inputs.velocity_mps[i] : -inputs.velocity_mps[i]);
    }
  }
  return worst;
}

// Whether the heading is vague, or the fence, drawn in, leaves less room than a path needs.
bool uncertain(const FailsafeSettings& settings, const FailsafeState& last, const FenceSettings& fence,
               const FailsafeInputs& inputs) noexcept {
  const bool brakes = last.mode == FailsafeMode::brake;
  if ((brakes ? 2 : 1) * inputs.sigma_yaw_rad > settings.max_yaw_sigma_rad) return true;
  for (std::size_t i = 0; i < 2; ++i) {
    if (inputs.sigma_m[i] <= 0) continue;
    const double sigmas = (brakes ? 2 : 1) * settings.fence_sigmas * inputs.sigma_m[i];
    if (fence.max_m[i] - fence.min_m[i] - 2 * sigmas < settings.min_room_m) return true;
  }
  return false;
}

bool hovers(FailsafeMode mode) noexcept { return mode == FailsafeMode::hold || mode == FailsafeMode::brake; }

FailsafeState change(const FailsafeState& last, TimeNs now, FailsafeMode mode, FailsafeCause cause) noexcept {
  FailsafeState next = last;
  next.hovering_since_ns = !hovers(mode) ? 0 : last.hovering_since_ns != 0 ? last.hovering_since_ns : now;
  if (mode != last.mode || cause != last.cause) next.cause_gone_since_ns = 0;
  next.mode = mode;
  next.cause = cause;
  return next;
}

void remember_battery(const FailsafeSettings& settings, FailsafeState& memory, const FailsafeInputs& inputs) noexcept {
  if (inputs.state_ns == 0) return;
  if (inputs.battery <= settings.battery_low) memory.battery_low = true;
  if (inputs.battery > settings.battery_low + settings.battery_margin) memory.battery_low = false;
}

void remember_fence(const FenceSettings& fence, FailsafeState& memory, TimeNs now, const FailsafeInputs& inputs,
                    bool pose_lost) noexcept {
  const Outside out = outside(fence, inputs, pose_lost);
  if (out.distance_m > 0) memory.outside_ns = now;
  const bool outward =
      out.distance_m > fence.far_beyond_m || (out.distance_m > 0 && (pose_lost || out.outward_mps > fence.outward_mps));
  update_since(now, outward, memory.outward_since_ns);
}

// Why there is nothing to fly; none: there is a plan, or it ended only just now.
FailsafeCause plan_gap_cause(const FailsafeSettings& settings, const FailsafeState& memory, TimeNs now,
                             const FailsafeInputs& inputs) noexcept {
  if (inputs.plan_valid) return FailsafeCause::none;
  const TimeNs since = std::max(inputs.covered_until_ns, inputs.flying_since_ns);
  if (!hovers(memory.mode) && now - since < settings.hold_grace_ns) return FailsafeCause::none;
  const bool was_silent = memory.mode == FailsafeMode::hold && memory.cause == FailsafeCause::agent_silent;
  const TimeNs limit = was_silent ? settings.agent_silent_ns / 2 : settings.agent_silent_ns;
  if (older(now, inputs.heartbeat_ns, limit)) return FailsafeCause::agent_silent;
  return inputs.ledger_alive ? FailsafeCause::plan_ran_out : FailsafeCause::ledger_silent;
}

}  // namespace

/// What the rows look at: the inputs against the limits, and what is remembered.
struct FailsafeMoment {
  const FailsafeSettings& settings;
  const FailsafeState& memory;
  TimeNs now;
  const FailsafeInputs& inputs;
  bool state_stale = false;
  bool pose_lost = false;           ///< and a position is needed
  bool position_uncertain = false;  ///< the same
  bool dark = false;                ///< the same: it may run away, and nobody would know
  bool sources_differ = false;      ///< the same
  FailsafeCause no_plan = FailsafeCause::none;
  bool resting = false;  ///< what made it hover is away, but not for clear_after

  bool on_ground() const noexcept { return !is_in_flight(inputs.phase) && !inputs.may_be_airborne; }
  bool has_cause_to_brake() const noexcept {
    return state_stale || pose_lost || dark || position_uncertain || sources_differ ||
           untrusted(OnUntrustedLedger::hold);
  }

  /// The ledger is, and the config wants this for it.
  bool untrusted(OnUntrustedLedger then) const noexcept {
    return inputs.ledger_untrusted && settings.on_untrusted_ledger == then;
  }
};

namespace {

using Moment = FailsafeMoment;

// A hold for lack of plans becomes one of silence at once; the reverse waits clear_after, so the cause does not
// flicker. A brake waits likewise.
void rest(Moment& at, FailsafeState& memory) noexcept {
  const bool silence = memory.mode == FailsafeMode::hold && memory.cause != FailsafeCause::plan_ran_out;
  const bool away =
      memory.mode == FailsafeMode::brake ? !at.has_cause_to_brake() : silence && at.no_plan != memory.cause;
  if (!away) {
    memory.cause_gone_since_ns = 0;
    return;
  }
  if (memory.cause_gone_since_ns == 0) memory.cause_gone_since_ns = at.now;
  // Beyond it, not at it: half of state_stale is as long, and one lonely state text must not end a brake.
  at.resting = at.now - memory.cause_gone_since_ns <= at.settings.clear_after_ns;
}

bool cut(const Moment& at) { return at.inputs.cut; }
bool stopped(const Moment& at) { return at.inputs.stop; }
bool battery_critical(const Moment& at) {
  return !older(at.now, at.inputs.state_ns, at.settings.state_stale_ns) &&
         at.inputs.battery <= std::max(double(at.settings.battery_critical), at.inputs.landing_battery);
}
bool leaves_fence(const Moment& at) {
  return at.memory.outward_since_ns != 0 && at.now - at.memory.outward_since_ns >= at.settings.fence_land_after_ns;
}
bool untrusted_lands(const Moment& at) { return at.untrusted(OnUntrustedLedger::land); }
bool state_stale(const Moment& at) { return at.state_stale; }
bool pose_lost(const Moment& at) { return at.pose_lost && !at.inputs.by_odometry; }
bool height_lost(const Moment& at) {
  return at.pose_lost && at.inputs.by_odometry && at.inputs.height_lost && !at.dark;
}
bool velocity_lost(const Moment& at) {
  return at.dark || (at.pose_lost && at.inputs.by_odometry && !at.inputs.height_lost);
}
// To hover is no way out: it feels no speed, so it glides on and drifts.
bool dark(const Moment& at) {
  return at.dark && at.inputs.phase == LinkPhase::flying &&
         at.now - at.inputs.dark_since_ns >= at.settings.dark_land_after_ns;
}
bool position_uncertain(const Moment& at) { return at.position_uncertain; }
bool check_failed(const Moment& at) { return at.inputs.check_failed; }
bool sources_differ(const Moment& at) { return at.sources_differ; }
bool sources_unresolved(const Moment& at) {
  return at.inputs.sources_unresolved && at.inputs.needs_position && at.inputs.phase == LinkPhase::flying;
}
bool overturned(const Moment& at) { return at.inputs.overturned && at.inputs.phase != LinkPhase::disconnected; }
bool tilted(const Moment& at) { return at.inputs.tilted; }
bool motion_differs(const Moment& at) { return at.inputs.motion_differs && at.inputs.phase == LinkPhase::flying; }
bool untrusted_holds(const Moment& at) { return at.untrusted(OnUntrustedLedger::hold); }
bool agent_silent(const Moment& at) { return at.no_plan == FailsafeCause::agent_silent; }
bool ledger_silent(const Moment& at) { return at.no_plan == FailsafeCause::ledger_silent; }
bool plan_ran_out(const Moment& at) { return at.no_plan == FailsafeCause::plan_ran_out; }
bool held_too_long(const Moment& at) {
  const TimeNs since = at.memory.hovering_since_ns;
  const bool brakes = at.has_cause_to_brake() || (at.memory.mode == FailsafeMode::brake && at.resting);
  const bool goes_on = brakes || at.no_plan != FailsafeCause::none;
  return at.inputs.phase == LinkPhase::flying && since != 0 && goes_on && at.now - since >= at.settings.land_after_ns;
}
bool outside_fence(const Moment& at) { return at.memory.outside_ns == at.now; }
bool too_near(const Moment& at) { return at.inputs.too_near; }
bool battery_low(const Moment& at) { return at.memory.battery_low; }
bool contact_lost(const Moment& at) { return at.inputs.contact_lost; }

bool long_ago(const Moment& at, TimeNs last_ns) {
  return last_ns == 0 || at.now - last_ns > at.settings.clear_after_ns;
}

// A landing is never taken back in the air.
constexpr ClearCondition when_on_ground{"on_ground", [](const Moment& at) { return at.on_ground(); }};
// While a cause to brake is there the table decides, by which of them; then the last one stays until it is rested.
constexpr ClearCondition when_rested{"when_rested", [](const Moment& at) { return !at.resting; }};
// Or with another cause, which one of silence is not taken for at once.
constexpr ClearCondition with_a_plan{"with_a_plan",
                                     [](const Moment& at) { return at.inputs.plan_valid || !at.resting; }};
constexpr ClearCondition back_inside{"back_inside",
                                     [](const Moment& at) { return long_ago(at, at.memory.outside_ns); }};
constexpr ClearCondition apart{"apart", [](const Moment& at) { return long_ago(at, at.memory.too_near_ns); }};
constexpr ClearCondition when_charged{"when_charged", [](const Moment& at) { return !at.memory.battery_low; }};

// The row that decided last, where that has a mode: warnings are remembered each by itself.
const FailsafeRow* row_in_force(const FailsafeState& memory) noexcept {
  if (memory.mode == FailsafeMode::none) return nullptr;
  const auto* const row = std::find_if(failsafe_table.begin(), failsafe_table.end(), [&](const FailsafeRow& r) {
    return r.mode == memory.mode && (r.cause == memory.cause || r.mode >= FailsafeMode::land);
  });
  return row == failsafe_table.end() ? nullptr : row;
}

bool is_considered(const FailsafeRow& row, LinkPhase phase) noexcept {
  return row.mode >= FailsafeMode::land || phase == LinkPhase::flying;
}

}  // namespace

const std::array<FailsafeRow, 26> failsafe_table{{
    {"FS-01", FailsafeCause::stopped, FailsafeMode::cut, cut, when_on_ground},
    {"FS-16", FailsafeCause::overturned, FailsafeMode::cut, overturned, when_on_ground},
    {"FS-02", FailsafeCause::stopped, FailsafeMode::land, stopped, when_on_ground},
    {"FS-67", FailsafeCause::check_failed, FailsafeMode::land, check_failed, when_on_ground},
    {"FS-03", FailsafeCause::battery_critical, FailsafeMode::land, battery_critical, when_on_ground},
    {"FS-04", FailsafeCause::fence, FailsafeMode::land, leaves_fence, when_on_ground},
    {"FS-17", FailsafeCause::tilted, FailsafeMode::land, tilted, when_on_ground},
    {"FS-18", FailsafeCause::motion_differs, FailsafeMode::land, motion_differs, when_on_ground},
    {"FS-47", FailsafeCause::velocity_lost, FailsafeMode::land, dark, when_on_ground},
    {"FS-43", FailsafeCause::sources_differ, FailsafeMode::land, sources_unresolved, when_on_ground},
    {"FS-14", FailsafeCause::ledger_untrusted, FailsafeMode::land, untrusted_lands, when_on_ground},
    {"FS-05", FailsafeCause::held_too_long, FailsafeMode::land, held_too_long, when_on_ground},
    {"FS-06", FailsafeCause::state_stale, FailsafeMode::brake, state_stale, when_rested},
    {"FS-07", FailsafeCause::pose_lost, FailsafeMode::brake, pose_lost, when_rested},
    {"FS-37", FailsafeCause::velocity_lost, FailsafeMode::brake, velocity_lost, when_rested},
    {"FS-48", FailsafeCause::height_lost, FailsafeMode::brake, height_lost, when_rested},
    {"FS-44", FailsafeCause::sources_differ, FailsafeMode::brake, sources_differ, when_rested},
    {"FS-19", FailsafeCause::position_uncertain, FailsafeMode::brake, position_uncertain, when_rested},
    {"FS-15", FailsafeCause::ledger_untrusted, FailsafeMode::brake, untrusted_holds, when_rested},
    {"FS-08", FailsafeCause::agent_silent, FailsafeMode::hold, agent_silent, with_a_plan},
    {"FS-09", FailsafeCause::ledger_silent, FailsafeMode::hold, ledger_silent, with_a_plan},
    {"FS-10", FailsafeCause::plan_ran_out, FailsafeMode::hold, plan_ran_out, with_a_plan},
    {"FS-60", FailsafeCause::too_near, FailsafeMode::none, too_near, apart},
    {"FS-11", FailsafeCause::fence, FailsafeMode::none, outside_fence, back_inside},
    {"FS-12", FailsafeCause::battery_low, FailsafeMode::none, battery_low, when_charged},
    {"FS-13", FailsafeCause::state_stale, FailsafeMode::land, contact_lost, when_on_ground},
}};

FailsafeState update(const FailsafeSettings& settings, const FenceSettings& fence, const FailsafeState& last,
                     TimeNs now, const FailsafeInputs& inputs) noexcept {
  FailsafeState memory = last;
  Moment at{.settings = settings, .memory = memory, .now = now, .inputs = inputs};
  remember_battery(settings, memory, inputs);
  if (at.on_ground()) {
    FailsafeState grounded;
    grounded.battery_low = memory.battery_low;
    grounded.cause = takeoff_refusal(settings, fence, now, inputs);
    if (grounded.cause == FailsafeCause::none && memory.battery_low) grounded.cause = FailsafeCause::battery_low;
    // Said, and no obstacle: the drone decides about the next one, too.
    if (grounded.cause == FailsafeCause::none && inputs.takeoff_refused_by_drone)
      grounded.cause = FailsafeCause::takeoff_refused_by_drone;
    return grounded;
  }
  at.state_stale = older(now, inputs.state_ns, tightened(settings.state_stale_ns, memory));
  const bool lost = lost_pose(settings, memory, now, inputs);
  at.pose_lost = lost && inputs.needs_position;
  at.position_uncertain = inputs.needs_position && (inputs.fix_overdue || uncertain(settings, memory, fence, inputs));
  at.dark = inputs.needs_position && inputs.dark_since_ns != 0;
  at.sources_differ = inputs.needs_position && inputs.sources_differ;
  at.no_plan = plan_gap_cause(settings, memory, now, inputs);
  remember_fence(fence_for(settings, fence, memory, now, inputs), memory, now, inputs, lost);
  if (inputs.too_near) memory.too_near_ns = now;
  rest(at, memory);

  const FailsafeRow* in_force = row_in_force(memory);
  // One that lies overturned while it is not connected lands for what is wrong with it now.
  const bool decides_again = memory.mode == FailsafeMode::land && inputs.overturned;
  const bool stays =
      in_force && is_considered(*in_force, inputs.phase) && !in_force->clears.holds(at) && !decides_again;
  for (const FailsafeRow& row : failsafe_table) {
    if (stays && row.mode <= memory.mode) return change(memory, now, memory.mode, memory.cause);
    if (!is_considered(row, inputs.phase)) continue;
    const bool warns = row.mode == FailsafeMode::none && !row.clears.holds(at);
    if (!warns && !row.applies(at)) continue;
    // The cause stays readable: only a mere lack of plans becomes "held too long".
    const bool known = row.cause == FailsafeCause::held_too_long && memory.cause != FailsafeCause::plan_ran_out;
    return change(memory, now, row.mode, known ? memory.cause : row.cause);
  }
  // Not seen: what a take-off waits for, as on the ground.
  const bool seen = is_in_flight(inputs.phase);
  return change(memory, now, FailsafeMode::none,
                seen ? FailsafeCause::none : takeoff_refusal(settings, fence, now, inputs));
}

FailsafeCause takeoff_refusal(const FailsafeSettings& settings, const FenceSettings& fence, TimeNs now,
                              const FailsafeInputs& inputs) noexcept {
  if (inputs.stop || inputs.cut) return FailsafeCause::stopped;
  if (inputs.check_failed) return FailsafeCause::check_failed;
  if (older(now, inputs.state_ns, settings.state_stale_ns)) return FailsafeCause::state_stale;
  if (inputs.other_client) return FailsafeCause::other_client;
  if (inputs.battery <= settings.battery_low) return FailsafeCause::battery_low;
  if (older(now, inputs.heartbeat_ns, settings.agent_silent_ns)) return FailsafeCause::agent_silent;
  if (!inputs.ledger_alive) return FailsafeCause::ledger_silent;
  if (inputs.ledger_untrusted && settings.on_untrusted_ledger != OnUntrustedLedger::ignore)
    return FailsafeCause::ledger_untrusted;
  if (inputs.tilt_rad > TiltWatch::no_takeoff_rad) return FailsafeCause::tilted;
  const bool lost = older(now, inputs.pose_ns, pose_limit_ns(settings, inputs.by_odometry));
  if (inputs.too_near) return FailsafeCause::too_near;
  const bool vague = uncertain(settings, {}, fence, inputs);
  if (!inputs.needs_position && (lost || vague)) return FailsafeCause::none;
  if (lost && !inputs.by_odometry) return FailsafeCause::pose_lost;
  if (lost) return inputs.height_lost ? FailsafeCause::height_lost : FailsafeCause::velocity_lost;
  if (vague) return FailsafeCause::position_uncertain;
  const FenceSettings holds = fence_for(settings, fence, {}, now, inputs);
  for (std::size_t i = 0; i < 2; ++i) {
    if (inputs.position_m[i] < holds.min_m[i] || inputs.position_m[i] > holds.max_m[i]) return FailsafeCause::fence;
  }
  return FailsafeCause::none;
}

FenceSettings fence_for(const FailsafeSettings& settings, const FenceSettings& fence, const FailsafeState& last,
                        TimeNs now, const FailsafeInputs& inputs) noexcept {
  constexpr double anywhere_m = 1e9;
  const bool vague = uncertain(settings, last, fence, inputs);
  const bool nowhere = lost_pose(settings, last, now, inputs) || inputs.sigma_m[0] > settings.lost_sigma_m;
  const bool unbounded = !inputs.needs_position && nowhere;
  FenceSettings holds = fence;
  for (std::size_t i = 0; i < 2; ++i) {
    // Where FS-19 brakes the box is not drawn in to nothing: it would land who is to hover.
    const double inward = unbounded ? -anywhere_m : vague ? 0 : settings.fence_sigmas * inputs.sigma_m[i];
    holds.min_m[i] += inward;
    holds.max_m[i] -= inward;
  }
  return holds;
}

Velocity clip_at_fence(const FenceSettings& fence, const std::array<double, 3>& position_m, float height_m,
                       Velocity desired, float push_mps) noexcept {
  for (std::size_t i = 0; i < 3; ++i) {
    const double highest = i == 2 ? std::max(position_m[i], double(height_m)) : position_m[i];
    // Heights push nobody: the floor is where a drone lands, and its own height may be wrong.
    const float push = i == 2 ? 0 : push_mps;
    const float up = std::max(-push, static_cast<float>((fence.max_m[i] - highest) / fence.slow_s));
    const float down = std::max(-push, static_cast<float>((position_m[i] - fence.min_m[i]) / fence.slow_s));
    desired.mps[i] = std::clamp(desired.mps[i], std::min(-down, up), up);
  }
  return desired;
}

}  // namespace ledgerline::link
