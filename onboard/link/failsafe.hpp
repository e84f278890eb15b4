#pragma once
#include "onboard/link/playout.hpp"
#include "onboard/link/settings.hpp"

namespace ledgerline::link {

/// What the failsafe is told, at every step. Times are when something last came; 0: never.
struct FailsafeFacts {
  FlightPhase phase = FlightPhase::disconnected;
  TimeNs flying_since_ns = 0;
  bool plan_valid = false;             ///< a plan covers this moment
  TimeNs covered_until_ns = 0;         ///< end of the newest plan
  TimeNs beat_ns = 0;                  ///< newest beat of agent
  bool ledger_alive = false;           ///< as that beat says
  TimeNs state_ns = 0;                 ///< newest state text of the drone
  TimeNs pose_ns = 0;                  ///< stamp of the newest pose
  std::array<double, 3> position_m{};  ///< of that pose, and moved on by what was sent since
  std::array<double, 3> velocity_mps{};
  float height_m = 0;  ///< the drone's own, for the fence without a pose
  float battery = 1;
  bool stop = false;  ///< from the ledger, or the local stop key
  bool cut = false;   ///< asked for by name
};

/// What the failsafe remembers and says. mode is the action:
///
/// | cause            | mode                          | clears when                                      |
/// | ---------------- | ----------------------------- | ------------------------------------------------ |
/// | plan_ran_out     | hold                          | a plan is valid again                            |
/// | agent_silent     | plan flown to its end, hold   | a plan is valid again (agent must live for one)  |
/// | ledger_silent    | plan flown to its end, hold   | a plan is valid again                            |
/// | held_too_long    | land                          | on the ground                                    |
/// | state_stale      | brake, then land              | state text within half the limit for clear_after |
/// | pose_lost        | brake, then land              | pose within half the limit for clear_after       |
/// | fence            | none (setpoint clipped), land | inside again; a landing: on the ground           |
/// | battery_low      | none (a warning)              | above the threshold by battery_margin            |
/// | battery_critical | land                          | on the ground                                    |
/// | stopped          | land, or cut                  | on the ground and no stop any more               |
///
/// A pose is lost when agent is heard without one; a dead agent takes its poses along, which counts as agent_silent.
/// land and cut never turn into anything milder in the air. Hold and brake turn into land after land_after, counted
/// from when flying began at the earliest: taking off gives no free time.
struct FailsafeState {
  FailsafeMode mode = FailsafeMode::none;
  FailsafeCause cause = FailsafeCause::none;
  TimeNs hovering_since_ns = 0;  ///< of hold or brake without a break
  TimeNs cause_gone_since_ns = 0;
  TimeNs outward_since_ns = 0;
  bool battery_low = false;
};

/// Pure: the next state from the last one, the time and the facts.
FailsafeState update(const FailsafeSettings& settings, const FenceSettings& fence, const FailsafeState& last,
                     TimeNs now, const FailsafeFacts& facts) noexcept;

/// Why the drone must not take off now; none: it may.
FailsafeCause takeoff_refusal(const FailsafeSettings& settings, TimeNs now, const FailsafeFacts& facts) noexcept;

/// The wish, slowed toward the fence and with no outward part at or beyond it.
Velocity clip_at_fence(const FenceSettings& fence, const std::array<double, 3>& position_m, Velocity wish) noexcept;

}  // namespace ledgerline::link
