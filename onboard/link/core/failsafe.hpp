#pragma once
#include <array>

#include "onboard/link/core/settings.hpp"
#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {

/// The failsafe's inputs at every step. Times are when something last came; 0: never.
struct FailsafeInputs {
  LinkPhase phase = LinkPhase::disconnected;
  bool may_be_airborne = false;  ///< disconnected, and not known to stand on the ground
  bool contact_lost = false;     ///< may_be_airborne, and every handshake failed or it is commanded to land
  TimeNs flying_since_ns = 0;
  bool plan_valid = false;             ///< a plan covers this moment
  TimeNs covered_until_ns = 0;         ///< end of the newest plan
  TimeNs heartbeat_ns = 0;             ///< newest heartbeat of agent
  bool ledger_alive = false;           ///< as that heartbeat says
  bool ledger_untrusted = false;       ///< as that heartbeat says
  TimeNs state_ns = 0;                 ///< newest state text of the drone
  TimeNs pose_ns = 0;                  ///< stamp of the newest pose
  std::array<double, 3> position_m{};  ///< of that pose, and moved on by what was sent since
  std::array<double, 3> velocity_mps{};
  std::array<double, 3> sigma_m{};  ///< standard deviations of that position; 0: not reported
  double sigma_yaw_rad = 0;         ///< of the heading; the same
  /// The pose comes from onboard odometry: it does not come through agent.
  bool by_odometry = false;
  /// False where what is flown, or was flown last, is by hand, by a pilot who is allowed to fly without a position.
  bool needs_position = true;
  bool motion_differs = false;  ///< from what it is sent (MotionWatch)
  /// Since when its flow is suspected to see nothing (FlowWatch) and nothing else says where it is; 0: no.
  TimeNs dark_since_ns = 0;
  bool other_client = false;              ///< commands it as well (ClientWatch)
  bool takeoff_refused_by_drone = false;  ///< a moment ago; it may be asked again
  bool height_lost = false;               ///< tof sees nothing, and without a height flow has no scale
  bool fix_overdue = false;               ///< it flies by mission pads, and has seen none for too long
  /// Motion capture and its own velocity contradict each other (pose/source_check.hpp): neither is used ...
  bool sources_differ = false;
  bool sources_unresolved = false;  ///< ... and have for so long that nothing is left to fly by
  bool tilted = false;              ///< beyond what flying needs (TiltWatch) ...
  bool overturned = false;          ///< ... and it lies so
  double tilt_rad = 0;
  double landing_battery = 0;  ///< share of the battery that landing from here takes (BatteryWatch)
  /// The drone's own, above where it took off; held against the fence's ceiling beside the pose, and alone without one.
  float height_m = 0;
  float battery = 1;
  /// Another drone of this host is in the way of its setpoint (separation.hpp); on the ground: of a take-off.
  bool too_near = false;
  bool check_failed = false;  ///< of this core, or of agent's, since it started
  bool stop = false;          ///< from the ledger, or the local stop key
  bool cut = false;           ///< asked for by name
};

/// What the failsafe remembers and says; mode is the action.
struct FailsafeState {
  FailsafeMode mode = FailsafeMode::none;
  FailsafeCause cause = FailsafeCause::none;
  TimeNs hovering_since_ns = 0;    ///< of hold or brake without a break
  TimeNs cause_gone_since_ns = 0;  ///< while it hovers: since when its cause is away
  TimeNs outward_since_ns = 0;     ///< beyond the fence and still going outward
  TimeNs outside_ns = 0;           ///< when it was beyond the fence last
  TimeNs too_near_ns = 0;          ///< when another was in its way last
  bool battery_low = false;
};

struct FailsafeMoment;

/// What ends a row that decided; update() evaluates it. The name is the one of docs/failsafe.md.
struct ClearCondition {
  const char* name;
  bool (*holds)(const FailsafeMoment&);
};

/// This cause leads to this mode, until it is cleared. In words, with the test of each: docs/failsafe.md.
struct FailsafeRow {
  const char* id;
  FailsafeCause cause;
  FailsafeMode mode;
  bool (*applies)(const FailsafeMoment&);
  ClearCondition clears;
};

/// What the modes mean and how they follow each other:
///
///          no plan: FS-08 to 10                 land_after: FS-05
///   none ──────────────────────────▶ hold ──────────────────────────────▶ land ──▶ none, on the ground
///   │ ▲ ▲      a plan again          │ │                                 ▲ ▲ │
///   │ │ └────────────────────────────┘ │ FS-06, 07, 15, 19, 37, 44, 48   │ │ │
///   │ │        rested                  ▼         land_after: FS-05       │ │ │
///   │ └────────────────────────────── brake ─────────────────────────────┘ │ │
///   ├──▶ stale state, lost pose, velocity: 06, 07, 15, 19, 37, 44, 48      │ │ cut asked for by name, or it
///   └──▶ stop, battery, fence, tilt, dark: 02-04, 13, 14, 17, 18, 43, 47, 67┘ ▼ lies overturned: FS-01, FS-16
///                                                                            cut ──▶ none, on the ground
///
/// none: the plan is flown, clipped at the fence and kept apart from other drones. hold: ramp to zero, and hover.
/// brake: the same with twice the deceleration, and the plans in hand are dropped. land: until it is on the ground.
/// cut: motors off.
///
/// By weight: of the rows that apply the first one decides (FS-13 stands last: without contact no other applies). It
/// stays in force until its clear condition holds; before that only a row of a heavier mode takes over. Rows that land
/// are looked at from take-off to the ground and while the drone may be airborne without state, the others while it
/// flies.
extern const std::array<FailsafeRow, 26> failsafe_table;

/// The fence as it holds now: drawn in by how uncertain the position is. By hand and without a usable position it is
/// the height alone: the walls are the pilot's to see.
FenceSettings fence_for(const FailsafeSettings& settings, const FenceSettings& fence, const FailsafeState& last,
                        TimeNs now, const FailsafeInputs& inputs) noexcept;

/// Pure: the next state from the last one, the time and the inputs.
FailsafeState update(const FailsafeSettings& settings, const FenceSettings& fence, const FailsafeState& last,
                     TimeNs now, const FailsafeInputs& inputs) noexcept;

/// Whether a flying drone is sent the plan's setpoint (clipped at the fence). If not, it is sent zero, or `land`.
constexpr bool follows_plan(FailsafeMode mode, bool plan_valid) noexcept {
  return plan_valid && mode == FailsafeMode::none;
}

/// Whether a drone that is to land can still be steered to a place with room below: its position is known, it does as
/// commanded, and nobody asked for it to be down at once. A brake has no usable position or state text.
inline bool can_wait_to_land(const FailsafeState& failsafe, const FailsafeInputs& inputs) noexcept {
  if (failsafe.mode != FailsafeMode::none && failsafe.mode != FailsafeMode::land) return false;
  const bool lost = failsafe.cause == FailsafeCause::pose_lost || failsafe.cause == FailsafeCause::velocity_lost ||
                    failsafe.cause == FailsafeCause::height_lost || failsafe.cause == FailsafeCause::sources_differ;
  return !inputs.check_failed && !inputs.stop && !inputs.cut && !inputs.tilted && !inputs.overturned &&
         !inputs.motion_differs && !lost;
}

/// How old the newest pose may be, by its source, before it counts as lost.
constexpr TimeNs pose_limit_ns(const FailsafeSettings& settings, bool by_odometry) noexcept {
  return by_odometry ? settings.velocity_lost_ns : settings.pose_lost_ns;
}

/// Why the drone must not take off now; none: it may.
FailsafeCause takeoff_refusal(const FailsafeSettings& settings, const FenceSettings& fence, TimeNs now,
                              const FailsafeInputs& inputs) noexcept;

/// The desired, slowed toward the fence and with no outward part at it; upward by the higher one of pose and the
/// drone's own height. That one is taken as it is: a step too early only slows the last 0.1 m. Beyond a wall it
/// goes back inside, with `push_mps` at most along each axis.
Velocity clip_at_fence(const FenceSettings& fence, const std::array<double, 3>& position_m, float height_m,
                       Velocity desired, float push_mps) noexcept;

}  // namespace ledgerline::link
