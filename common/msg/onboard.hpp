#pragma once
#include <array>
#include <cstdint>

#include "common/msg/contract.hpp"
#include "common/rt/clock.hpp"

/// What link and agent say to each other through shared memory: plain data, no pointers.
/// Positions and velocities are in the map frame (REP 103/105: x east, y north, z up), metres and metres per second;
/// yaw is counter-clockwise from x, radians. Times are the drone host's CLOCK_MONOTONIC.
namespace ledgerline {

/// Drones are numbered from 1: number k is the name `tello<k>` unless the config says otherwise.
using DroneNumber = std::uint16_t;
inline constexpr DroneNumber max_drones = 16;

/// A Tello's UDP ports, as SDK 1.3 to 3.0 have them: of commands and their answers, of state texts, of video.
inline constexpr std::uint16_t command_port = 8889, state_port = 8890, video_port = 11111;

/// What a plan wants. The first three are also on the wire (ledgerline.proto uses the same values); the others are said
/// by agent alone, from the contract's control records: land now; motors off at once, only where asked for by name;
/// nobody has it stopped on the ledger any more; and that the owner's organisation cleared its stop, which clears
/// link's local stop as well.
enum class PlanAction : std::uint8_t {
  fly = 0,
  takeoff = 1,
  land = 2,
  stop = 3,
  cut = 4,
  stop_cleared = 5,
  stop_cleared_by_owner = 6
};
constexpr bool is_contract_stop(PlanAction action) noexcept {
  return action == PlanAction::stop || action == PlanAction::cut;
}
/// From the ledger, not from the lease's holder: such a plan answers no state, carries no sequence, and is always
/// obeyed unless it is older (`verified_ns`) than the stop that it would clear.
constexpr bool is_contract_action(PlanAction action) noexcept {
  return action >= PlanAction::stop && action <= PlanAction::stop_cleared_by_owner;
}

/// Where the flight is, as link sees it.
enum class LinkPhase : std::uint8_t {
  disconnected = 0,
  on_ground = 1,
  taking_off = 2,
  flying = 3,
  landing = 4,
  landed = 5
};
constexpr bool is_in_flight(LinkPhase phase) noexcept {
  return phase == LinkPhase::taking_off || phase == LinkPhase::flying || phase == LinkPhase::landing;
}
constexpr bool is_on_ground(LinkPhase phase) noexcept {
  return phase == LinkPhase::on_ground || phase == LinkPhase::landed;
}

/// What the failsafe does now; `none` while the plan is flown.
enum class FailsafeMode : std::uint8_t { none = 0, hold = 1, brake = 2, land = 3, cut = 4 };

/// Why the failsafe is in its mode (the causes of docs/failsafe.md); on the ground: what speaks against a take-off.
enum class FailsafeCause : std::uint8_t {
  none = 0,
  plan_ran_out = 1,
  held_too_long = 2,
  agent_silent = 3,
  ledger_silent = 4,
  state_stale = 5,
  pose_lost = 6,
  fence = 7,
  battery_low = 8,
  battery_critical = 9,
  stopped = 10,
  ledger_untrusted = 11,
  velocity_lost = 12,
  position_uncertain = 13,
  motion_differs = 14,
  tilted = 15,
  overturned = 16,
  too_near = 17,      ///< another drone of this host
  height_lost = 18,   ///< tof sees nothing, and a drone's own velocity has no scale without
  other_client = 19,  ///< on the ground: somebody else says `command` to it as well
  sources_differ = 20,
  check_failed = 21,             ///< of link's core or agent's: what else is wrong, nobody knows
  takeoff_refused_by_drone = 22  ///< on the ground: its own answer to the newest `takeoff`
};

/// Why a plan or setpoint was not flown.
enum class DropReason : std::uint8_t {
  none = 0,
  too_old = 1,
  out_of_order = 2,
  superseded = 3,
  bad_value = 4,
  not_flying = 5,
  queue_full = 6
};

/// m/s or rad/s. More than any drone here can do: such a number is an error, not a setpoint to be limited.
inline constexpr float absurd_speed = 100;
/// The same of a place: a kilometre from the map's origin along each axis is what paths may have.
inline constexpr float absurd_m = 2'000;

/// How a drone's velocity v answers the velocity u that it is sent, with the wind's push w [m/s]:
///
///     lag dv/dt = gain u(t - dead) + w - v
///
/// first order with dead time, the usual model of a closed velocity loop (Seborg, Edgar, Mellichamp: Process Dynamics
/// and Control, 5.4 and 7.2).
struct Response {
  double gain = 1.0;
  double lag_s = 0.25;
  double dead_s = 0.06;
};
/// What no drone has is an error. False of what is no number, too.
constexpr bool is_plausible(const Response& r) noexcept {
  return r.gain >= 0.2 && r.gain <= 4 && r.lag_s >= 0.02 && r.lag_s <= 2 && r.dead_s >= 0 && r.dead_s <= 1;
}

/// Where a path has its drone when what is sent at the setpoint's moment takes effect (one dead time later), in `map`;
/// behind that moment it moves on by its velocity and acceleration. Link holds the drone to it.
struct Reference {
  std::array<float, 3> position_m{};
  std::array<float, 3> velocity_mps{};
  std::array<float, 3> acceleration_mps2{};
};

/// A velocity setpoint for a moment on the drone host's clock.
struct Setpoint {
  TimeNs at_ns = 0;
  std::array<float, 3> velocity_mps{};
  float yaw_rate_radps = 0;
  bool has_reference = false;
  Reference reference{};
};

inline constexpr std::uint32_t max_setpoints = contract::max_plan_setpoints;

/// agent -> link: a verified command. Setpoints are in order of time.
struct Plan {
  DroneNumber drone = 0;
  PlanAction action = PlanAction::fly;
  std::uint64_t sequence = 0;  ///< grows by one per command of an operator's session (lease epoch)
  std::uint64_t epoch = 0;     ///< lease epoch; sequence restarts with it
  TimeNs state_stamp_ns = 0;   ///< of the state that it was made from
  TimeNs verified_ns = 0;      ///< when agent handed it over: two-way latency = verified - state_stamp
  bool body_frame = false;     ///< flown by hand: velocities are in the drone's own frame, forward, left, up
  Response response{};         ///< of the drone, as who planned it has learned
  std::uint32_t count = 0;
  std::array<Setpoint, max_setpoints> setpoints{};
};

/// How well a pose is known: variances along x, y, z [m2] and of yaw [rad2]. Zeros: not reported (motion capture).
using PoseVariance = std::array<float, 4>;

/// agent -> link: fused pose and velocity.
struct Pose {
  DroneNumber drone = 0;
  TimeNs stamp_ns = 0;  ///< of the measurement, not of the fusion
  std::array<double, 3> position_m{};
  std::array<double, 3> velocity_mps{};
  double yaw_rad = 0;
  PoseVariance variance{};
};

/// agent -> link, at least ten times a second. An agent on several channels sends one for each, with the drones of it.
struct AgentHeartbeat {
  TimeNs stamp_ns = 0;
  std::uint32_t drones = all_drones;  ///< whom it is for: bit N of drone N
  bool ledger_alive = false;          ///< blocks or commits came lately
  bool ledger_untrusted = false;  ///< what agent is shown of it contradicts itself, others or agent's own validation
  bool check_failed = false;      ///< one of agent's core (LEDGERLINE_CHECK)
  /// Of each drone's transitions, by its number: the newest that agent keeps, and the newest on the ledger; of that
  /// boot of link.
  std::uint64_t boot_id = 0;
  std::array<std::uint64_t, max_drones + 1> transitions_taken{};
  std::array<std::uint64_t, max_drones + 1> transitions_on_ledger{};

  static constexpr std::uint32_t all_drones = 0xFFFF'FFFF;
  static constexpr std::uint32_t bit_of(DroneNumber drone) { return 1U << drone; }
  bool is_for(DroneNumber drone) const { return drone <= max_drones && (drones & bit_of(drone)) != 0; }
};
static_assert(max_drones < 32);

/// link -> agent: the failsafe changed its mode or cause, or the flight its phase. On the ground the cause, which only
/// says what a take-off waits for, is none. Unlike states none may be lost: link keeps each until it is on the ledger.
struct Transition {
  DroneNumber drone = 0;
  LinkPhase phase = LinkPhase::disconnected;
  FailsafeMode mode = FailsafeMode::none;
  FailsafeCause cause = FailsafeCause::none;
  std::uint64_t boot_id = 0;
  std::uint64_t number = 0;  ///< from 1, one more each time, for each drone and boot: a gap shows what is missing
  std::uint64_t oldest = 0;  ///< number of the oldest that link keeps
  std::uint64_t lost = 0;    ///< how many of this boot link had to drop, see TransitionLog
  TimeNs stamp_ns = 0;
};

/// link -> agent: one sample of a drone, and what link really did.
struct StateSample {
  DroneNumber drone = 0;
  LinkPhase phase = LinkPhase::disconnected;
  FailsafeMode mode = FailsafeMode::none;
  FailsafeCause cause = FailsafeCause::none;
  std::uint64_t boot_id = 0;   ///< of this start of link: stamps of another are refused
  std::uint64_t sequence = 0;  ///< grows by one per drone and sample
  TimeNs stamp_ns = 0;         ///< when it was sampled
  TimeNs pose_stamp_ns = 0;    ///< 0: no pose yet
  std::array<double, 3> position_m{};
  std::array<double, 3> velocity_mps{};
  double yaw_rad = 0;
  float battery = 0;  ///< 0..1; on the ground below 0: not known yet
  float tof_m = 0;
  float height_m = 0;  ///< the Tello's own `h`, above take-off
  bool sdk_state_fresh = false;
  std::uint64_t applied_sequence = 0;        ///< of the last plan a setpoint was flown from
  TimeNs playout_margin_ns = 0;              ///< so much later than they say setpoints are flown now
  std::uint64_t arrived_sequence = 0;        ///< of the newest plan that came
  TimeNs arrived_ns = 0;                     ///< when it came
  std::array<float, 3> sent_velocity_mps{};  ///< the setpoint as sent, after limits and failsafe
  float sent_yaw_rate_radps = 0;
  /// Roll, pitch and yaw as the Tello reports them, in REP 103's signs; its yaw counts from power on.
  std::array<float, 3> attitude_rad{};
  std::array<float, 3> acceleration_mps2{};  ///< its own, with gravity: x forward, y left, z up; 0, 0, 9.8 at rest
  PoseVariance pose_variance{};
  // For people at link's host; not on the ledger.
  std::uint32_t plans_late = 0;  ///< counters since boot
  std::uint32_t plans_dropped = 0;
  std::uint32_t plans_applied = 0;
  float temperature_c = 0;  ///< the hotter one of the two that it reports; 0: none
  bool hot = false;         ///< beyond what it should be where it is
  bool contested = false;   ///< another client commands it as well (ClientWatch) ...
  bool diverted = false;    ///< ... or it answers, and its state texts stay away
};

}  // namespace ledgerline
