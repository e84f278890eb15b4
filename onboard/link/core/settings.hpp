#pragma once
#include <array>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "common/base/enum_count.hpp"
#include "common/msg/onboard.hpp"

/// Every threshold of link's cores, with its default. The shell reads them from TOML (link_config.hpp); hil and tests
/// fill them in directly. Each says why it has its value; the facts about the drone are from docs/sources.md.
namespace ledgerline::link {

struct SessionSettings {
  /// A battery is as low as battery_says_so of the newest battery_texts state texts say. One text that is torn or
  /// another drone's lands nobody; and where every second text is another drone's, which is charged, its own low one is
  /// accepted within 0.4 s. With two of two, those would hide it for ever; with two of eight, two torn texts within
  /// 0.8 s land; with three of four, every second text is not enough.
  static constexpr std::size_t battery_texts = 4, battery_says_so = 2;
  /// First try of `command`; doubles with each further one. A Tello near its access point answers within tens of ms:
  /// half would ask twice on a slow radio, double delays a first contact.
  TimeNs answer_timeout_ns = 500 * ns_per_ms;
  /// A drone that is switched on later is found this late. Half is twice the chatter; double keeps a person waiting.
  TimeNs answer_timeout_max_ns = 4 * ns_per_s;
  /// Clients wait 20 s; a take-off takes about 4 s. Half is close to that where the climb is slow, and a drone that
  /// still rises would be asked again; double waits 20 s where the answer is lost and the drone hovers already.
  TimeNs takeoff_timeout_ns = 10 * ns_per_s;
  /// After a refused take-off, before the next may be tried: a drone that refuses (low battery, a bad IMU) refuses
  /// again. Half asks twice as often for the same answer; double keeps a person who repaired the cause waiting.
  TimeNs refused_pause_ns = 2 * ns_per_s;
  /// `land` is sent again while the drone does not come down: its answer comes when it is down. With half it may answer
  /// twice, and answers carry no id; double costs two seconds of hovering for a lost datagram.
  TimeNs land_repeat_ns = 1 * ns_per_s;
  /// `emergency` is repeated until the drone is seen on the ground; repeating does no harm. With 60 % lost, nine of ten
  /// hear one of five. Double takes as long as the fall; half only sends more.
  TimeNs cut_repeat_ns = 100 * ns_per_ms;
  TimeNs cut_often_for_ns = 2 * ns_per_s;  ///< longer than a fall; then as often as `land`
  /// On the ground, without state text: disconnected. 30 texts at 10 Hz: half would disconnect a drone for fifteen
  /// lost ones; double shows a drone that is off as ready for longer.
  TimeNs lost_after_ns = 3 * ns_per_s;
  /// Landing, with neither answer nor state text: disconnected. From 10 m at 0.5 m/s it takes 20 s: half would give
  /// up on a drone that is still coming down; double holds up the end of link behind one that is gone.
  TimeNs landing_lost_after_ns = 30 * ns_per_s;
  /// Seen on the ground for so long it stands there: motors spin up for a second or two before a take-off, which a link
  /// that is gone may have begun. Double only delays a first take-off.
  TimeNs stands_after_ns = 3 * ns_per_s;
  /// To a drone that is not seen and may fly (lost_link_protocol.hpp). So many `command`, at 0, 0.5 and 1.5 s, all
  /// given up 3.5 s after the first: a state text comes every 100 ms, an answer within tens of ms. One would end a
  /// flight for a lost datagram; with six a drone that is not heard hovers for 15.5 s before it is landed.
  int handshakes = 3;
  TimeNs zero_gap_ns = 100 * ns_per_ms;  ///< between two zeros meanwhile: with 60 % lost, 92 % hear one of five
  /// Between two `land` or `emergency`, each behind a `command` and a zero: twice as often as to a drone that is seen.
  TimeNs lost_link_repeat_ns = 500 * ns_per_ms;
  /// Longer than a take-off, which ignores `land` (4 s); with 60 % lost, 99.8 % hear one of twelve.
  TimeNs lost_link_land_for_ns = 6 * ns_per_s;
  /// Then nothing: longer than the 15 s after which a Tello lands by itself plus what the network may delay. Shorter
  /// would hold a drone in the air that hears everything but `land`; longer makes a user who switches a drone on after
  /// link wait for as long (ground waits 30 s for a drone).
  TimeNs silence_ns = 16 * ns_per_s;
  /// At shutdown, how long `land` or `emergency` is sent to a drone that was never heard from, seven times: usually
  /// there is none, and a person waits.
  TimeNs unheard_land_for_ns = 3 * ns_per_s;
  /// Starts of link within starts_within_ns (below), of which the last one commands every drone to land in its first
  /// step: who dies so often cannot fly, and each start keeps a Tello up. The launcher gives up with as many.
  int many_starts = 7;
  /// From here on it is in the air. `h` has steps of 0.1 m: 0.15 accepts one step, 0.5 takes a low hover for standing.
  float airborne_m = 0.25F;
  /// Up to this distance it is down: tof shows 0.10 m on the ground. Half is never seen; double is a low hover.
  float grounded_m = 0.15F;
};

struct PlayoutSettings {
  /// A FLY or TAKEOFF plan made from an older state is dropped: at 1 m/s the drone is 2 m from there. Half would refuse
  /// most plans of a ledger that takes a second both ways; double flies what was planned for another place.
  TimeNs max_age_ns = 2 * ns_per_s;
  /// A later setpoint is a bad value: perhaps of another host's clock. It must be above what ground plans ahead and the
  /// ledger's delay, or good plans are dropped; double only lets errors wait for longer.
  TimeNs max_ahead_ns = 5 * ns_per_s;
  /// How long the only setpoint of a plan is valid: three plans at 30 Hz, so that one lost plan leaves no gap. Half
  /// is less than two plans, and jitter makes gaps; double flies 0.1 m further at 1 m/s with no plan behind it.
  TimeNs default_hold_ns = 100 * ns_per_ms;
  /// Upper bound of how long the last setpoint of any plan is valid. Half cuts short a plan whose setpoints are half
  /// a second apart; double is a second of flight that nobody planned.
  TimeNs max_hold_ns = 500 * ns_per_ms;
  /// Upper bound of the adaptive playout margin; 0 disables it. Blocks of 50 commands at 30 Hz ask for 0.8 s
  /// (BurstsTest). Half drops part of such plans as late; double flies a metre behind the path at 0.5 m/s.
  TimeNs max_margin_ns = 1 * ns_per_s;
  /// Of the plans' lateness: so many are to come in time. The rest is bridged by the plan before. At 0.9 three plans a
  /// second are late; at 0.995 the third latest of 256 decides, and one stall delays the flight for 8 s.
  double margin_quantile = 0.98;
  /// Of the horizontal velocity: stopped within half a metre at 4 m/s². rc ends at 1 m/s as clients have it, so half is
  /// felt by nobody; doubled it stops within two metres, and leaves the slow mode.
  float max_speed_mps = 2.0F;
  /// Half of it: the drone's own height comes ten times a second, so it is known to 0.1 m. Halved a landing path
  /// takes twice as long; doubled the floor is 0.2 m nearer than the newest text says.
  float max_vertical_mps = 1.0F;
  float max_yaw_rate_radps = 1.75F;  ///< 100 degrees a second, what rc 100 is to clients: more could not be sent
  /// Of the whole velocity vector; also the ramp to zero. A tilt of 22 degrees, what the simulated drone can do: from
  /// 1 m/s it stops within 0.13 m, with half within 0.25 m; double the drone cannot follow.
  float max_acceleration_mps2 = 4.0F;
  float max_yaw_acceleration_radps2 = 6.0F;  ///< to the full rate within 0.3 s, as the velocity's first-order response
};

struct RcSettings {
  float full_scale_mps = 1.0F;  ///< what rc 100 means; not documented, clients call it cm/s
  /// The same: clients call it degrees per second.
  float full_scale_radps = 100.0F * std::numbers::pi_v<float> / 180.0F;
  /// From (left, forward, up, counter-clockwise) to rc (a, b, c, d). rc a positive is right, d positive is clockwise.
  std::array<float, 4> signs{-1, 1, 1, -1};
  /// Between any two rc, for a new plan's first setpoint: 200 a second at most. Half lets a burst of plans send 400;
  /// double makes a plan's first setpoint up to 10 ms older.
  TimeNs min_gap_ns = 5 * ns_per_ms;
  TimeNs changing_gap_ns = 20 * ns_per_ms;  ///< while the setpoint is ramped: at 4 m/s² steps of 0.08 m/s
  /// While flying, an rc is never further apart: one that is lost is made good within 50 ms, 5 cm at 1 m/s. Half
  /// doubles the datagrams of every hover; with double a lost one costs 10 cm. It is also the Tello's sign of life:
  /// after 15 s without a word it would land by itself (docs/sources.md).
  TimeNs max_gap_ns = 50 * ns_per_ms;
};

/// What the failsafe does while agent does not trust the ledger.
enum class OnUntrustedLedger : std::uint8_t { ignore = 0, hold = 1, land = 2 };
constexpr const char* name(OnUntrustedLedger action) noexcept {
  return name_of(action, std::array{"ignore", "hold", "land"});
}

struct FailsafeSettings {
  /// From the end of the plan until the mode says hold; the ramp to zero begins at once. Three plans at 30 Hz: with
  /// half each late plan is a hold, and each hold a transition on the ledger; with double a gap of six goes unsaid.
  TimeNs hold_grace_ns = 100 * ns_per_ms;
  /// Of hold or brake, then land. Long enough for an agent that is started again (docs/failsafe.md), short beside 13
  /// min of battery. Half lands for a pause that would have ended; double lets a drone drift for 10 s.
  TimeNs land_after_ns = 5 * ns_per_s;
  /// Agent sends a heartbeat every 50 ms, every 100 at the latest: five in a row are missing. With half a silence would
  /// go on until heartbeats come closer than 125 ms, and one late heartbeat would keep it; with double a hold says for
  /// a second that plans ran out, when agent is dead. A plan in hand is flown to its end either way.
  TimeNs agent_silent_ns = 500 * ns_per_ms;
  /// The Tello's state text comes at 10 Hz: ten in a row are missing. With half five lost texts brake, and end it only
  /// closer than 250 ms; with double the drone flies two metres at 1 m/s with neither battery nor height known.
  TimeNs state_stale_ns = 1 * ns_per_s;
  /// While agent is heard. At 1 m/s the place is known to 0.3 m when the brake begins: double doubles that. Half must
  /// still be more than mocap's period, and so must its half, by which a brake ends.
  TimeNs pose_lost_ns = 300 * ns_per_ms;
  /// Of a drone that is flown by onboard odometry: without a usable velocity. Five texts are missing, or see nothing:
  /// half a metre unmeasured at 1 m/s. Half is two lost texts and a late one; double is a metre.
  TimeNs velocity_lost_ns = 500 * ns_per_ms;
  /// Of a drone that is suspected to see nothing and that nothing else places or holds: its sticks are at zero at once,
  /// and after this it lands. Five texts, in which one that sees shows it: half is two lost texts and a late one; with
  /// double it glides half a metre on at 1 m/s, in the dark.
  TimeNs dark_land_after_ns = 500 * ns_per_ms;
  /// The fence is drawn in by so many standard deviations of the position: beyond three is one sample in 370.
  double fence_sigmas = 3;
  /// So much of it must be left along x and y. Half is narrower than a drone overshoots; double refuses rooms of 3 m.
  double min_room_m = 0.5;
  /// Of the heading, 17 degrees: with more a path leads somewhere else, and the fence holds another place. Half is what
  /// somebody makes who puts a drone down by eye twice; double is a spiral.
  double max_yaw_sigma_rad = 0.3;
  /// Of the position: with more nobody knows where it is, and a fence around that place would hold it anywhere.
  double lost_sigma_m = 5;
  /// A brake, a silence or a warning ends when its cause has been away this long. At least half of each limit above
  /// (FS-29), or one lonely sign of life ends it: 500 ms is that of state_stale. Half is refused with the other
  /// defaults; double adds half a second of hovering to each brake.
  TimeNs clear_after_ns = 500 * ns_per_ms;
  /// Beyond the fence and still going outward. At most a metre at 1 m/s, far_beyond_m: with half a gust (1 s,
  /// docs/sources.md) lands a drone that would have turned back; with double it is two metres out.
  TimeNs fence_land_after_ns = 1 * ns_per_s;
  /// No take-off, and a warning in the air: of 13 min nearly 2 are left. Half is below battery_critical; with double
  /// a third of each battery cannot be taken off with.
  float battery_low = 0.15F;
  /// Land at once: a minute is left. Half is below the 5 % at which a Tello refuses to take off; double above
  /// battery_low.
  float battery_critical = 0.08F;
  /// A low battery is forgotten only above the threshold by this: the state text has whole percents, so 0.01 is one
  /// step back and forth. Half is still a step; double holds a warning up for longer where a battery was changed.
  float battery_margin = 0.03F;
  /// Agent leaves out what cannot be trusted, which becomes silence: so nothing is done besides unless the config asks
  /// for it. A peer that feeds agent blocks can take that trust away at will, and would bring drones down.
  OnUntrustedLedger on_untrusted_ledger = OnUntrustedLedger::ignore;
};

/// Who says where a drone is.
enum class PoseSource : std::uint8_t {
  mocap = 0,            ///< motion capture, or any other topic of poses, through agent
  tello = 1,            ///< its own velocities and heights (pose/odometry.hpp)
  pads = 2,             ///< the same, and mission pads as fixes
  mocap_then_tello = 3  ///< motion capture, and onboard odometry while that is missing (pose/drone_position.hpp)
};
constexpr bool uses_mocap(PoseSource source) noexcept {
  return source == PoseSource::mocap || source == PoseSource::mocap_then_tello;
}
constexpr bool uses_odometry(PoseSource source) noexcept { return source != PoseSource::mocap; }
constexpr const char* name(PoseSource source) noexcept {
  return name_of(source, std::array{"mocap", "tello", "pads", "mocap+tello"});
}

/// A drone's own odometry. Standard deviations, of the simulator's drone where nobody measured a Tello [A].
struct OdometrySettings {
  /// Where it stands, and which way its nose points, when link first sees it, or when it was switched off and on.
  std::array<double, 3> start_m{};
  double start_yaw_rad = 0;
  double start_sigma_m = 0.02;     ///< how well somebody puts a drone on a mark
  double start_sigma_rad = 0.035;  ///< two degrees, by eye
  /// Of vgx, vgy, vgz against forward, left, up: nobody documents them, `ledgerline tello calibrate` measures them.
  std::array<float, 3> velocity_signs{1, 1, 1};
  /// Whether those turn with the drone; else they are reported in the frame it had at power on.
  bool velocity_in_body = false;
  /// Slow error of the optical flow's velocity, along x and along y, and how long it lasts (correlation time). A
  /// hovering Tello drifts by up to 5 cm/s and goes on to for a minute [A]. Half is beside the truth by three
  /// deviations then; double ends a flight without fixes after 20 s in a room of 6 m.
  double flow_mps = 0.035, flow_s = 60;
  /// Its scale, by a height. In the one public trace of a Tello 0.7 m of 1.0 m were reported, two of these. Half would
  /// draw the fence in by what a third of drones exceed; double ends a flight of 10 m.
  double flow_scale = 0.15;
  double velocity_scale = 1;        ///< what vgx and vgy are multiplied by
  bool velocity_truncated = false;  ///< they are cast to whole dm/s, toward zero; else rounded
  /// By how much vgx and vgy are late, and may be: nobody documents it, texts carry no time [A]. Its place is off by
  /// that and the change of its speed since it was known.
  double velocity_lag_s = 0, velocity_lag_sigma_s = 0.2;
  double heading_rad_per_sqrt_s = 0.0005;  ///< the gyroscope's random walk: 0.4 degrees in four minutes
  /// How fast the reported pose follows a fix that corrects it: half of a slow flight's speed, so that a drone on a
  /// path is led back, not thrown. Double is a jolt of 0.4 m/s; half takes ten seconds for a metre.
  double correction_mps = 0.2;
  /// With pads: a path is flown for so long, and so far, without one seen. Then it brakes: 5 cm/s that flow is wrong by
  /// are 1.5 m. Half is a path around a room; double is twice as far beside it.
  double max_unfixed_s = 30, max_unfixed_m = 15;
};

/// A mission pad: where it lies in `map`, and which way its arrow points.
struct PadSettings {
  int id = 0;  ///< 1 to 8
  std::array<double, 3> position_m{};
  double yaw_rad = 0;
};

struct FenceSettings {
  std::array<double, 3> min_m{-20, -20, 0};  ///< 40 m by 40 m: a user who flies in a room sets its bounds
  std::array<double, 3> max_m{20, 20, 3};
  /// Outward speed is at most the distance to the fence over this. With its response of 0.3 s a drone overshoots by 2 %
  /// of the way; with half by 13 %, double flies the last 1.4 m slower for nothing.
  double slow_s = 0.7;
  /// Beyond the fence, faster than this is still going outward. Gusts move a hovering drone so (docs/sources.md,
  /// assumed): half takes a hover for a flight, double drifts on at 0.2 m/s until far_beyond_m.
  double outward_mps = 0.1;
  /// Beyond the fence by this counts as still going outward, at any speed: it does not come back by itself. Half is
  /// the way to stop from 2 m/s; double is a metre more that a room beside the fence must leave free.
  double far_beyond_m = 1;
};

/// How link holds a drone to its plan's references, and to its place where it is to stay (track/tracker.hpp).
struct TrackSettings {
  bool on_board = true;  ///< else the plan's velocities alone are flown
  /// 1/s. With 2 the rms is a twentieth more (flights around a square, a triangle and an x in wind); 4 is near to what
  /// the dead time allows.
  double position_gain = 3;
  double velocity_gain = 0.8;  ///< half lets a drone that hears late, or flies in the dark, swing more
  double height_gain = 1;      ///< 1/s, as ground's
  /// Beyond what was planned: three times a gust's rms. Half lets 2 m/s of wind through; what is signed is flown, and
  /// nothing that is far from it.
  double max_correction_mps = 0.3;
};

/// How far drones of one host are kept apart, and by which model of them (separation.hpp).
struct SeparationSettings {
  /// Never nearer, centre to centre; in height as well, since a rotor's wash goes down. 0: drones are not kept apart.
  /// A Tello with its guards is 0.18 m wide. With half, a gust of 0.5 m/s for 0.3 s is more than what is left between
  /// two; with double three layers are all that fit under a ceiling of 3 m.
  double min_m = 0.5;
  /// On top, for what the model does not know: an rc's rounding and gap, noise of poses. With 0.15 one of a hundred
  /// flights of eight comes to 0.495 m; double keeps drones apart that could pass.
  double margin_m = 0.18;
  double response_s = 0.3;   ///< of the drone to a velocity, first order (docs/sources.md)
  double reaction_s = 0.05;  ///< RcSettings::changing_gap_ns, and what the radio takes
  /// Who has the right of way is yielded to for so long ahead: out of its way in height takes the other 1.7 s. Half
  /// makes the one with the right of way brake, double makes others yield to who will turn before.
  double lookahead_s = 2;
  /// Out of another's way in height. A landing's speed, the half of max_vertical: half keeps others waiting for 3 s,
  /// double climbs 0.4 m beyond where it is commanded to stop.
  double part_mps = 0.5;
  /// A landing waits so long until nobody is below, then it begins all the same. Half ends within detour_after_s and
  /// one way round, 6 s; double goes beyond the 20 s in which ground sees it land.
  double landing_wait_s = 10;
};

struct DroneSettings {
  std::string name;
  DroneNumber number = 0;
  PoseSource source = PoseSource::mocap;
  OdometrySettings odometry{};
  /// The signs and the frame of vgx and vgy are known: else motion capture cannot be held against them.
  bool velocity_known = true;
  /// When no pose of motion capture has come for so long, onboard odometry takes over: three poses of 30 Hz. Half
  /// changes over for one that is lost; with double and a lost text pose_lost_ns is over: it brakes.
  TimeNs odometry_after_ns = 100 * ns_per_ms;
  /// A pilot, who sees it, may fly it and take off without a usable position; then only the fence's ceiling holds.
  bool by_hand_without_pose = false;
  std::string serial{};  ///< what `sn?` must answer before a take-off; empty: not asked
  /// Its poses are in the frame of the others': only then it can be kept apart from them.
  bool in_common_frame = true;
};

struct LinkSettings {
  std::vector<DroneSettings> drones;
  /// Of state samples: a sample is 17 ms old on average when something is made from it, three for each state text of
  /// the Tello. Half makes that 33 ms; double is twice the ledger's load.
  double rate_hz = 30;
  /// Between two steps; a longer one means that link is not healthy. 250 steps of the real-time loop: half takes a
  /// busy machine's scheduler for a fault; with double the drone flies half a metre at 1 m/s on an rc of long ago.
  TimeNs health_gap_ns = 250 * ns_per_ms;
  /// ... for this long: no rc, so that a link that stutters lets the Tello land itself. With half one that stutters
  /// twice a second would send, and hold the drone up. Double delays the hold that follows.
  TimeNs health_rest_ns = 1 * ns_per_s;
  SessionSettings session;
  PlayoutSettings playout;
  RcSettings rc;
  FailsafeSettings failsafe;
  FenceSettings fence;
  std::vector<PadSettings> pads;  ///< for drones whose source they are
  TrackSettings track;
  SeparationSettings separation;
};

/// Starts further back count no more: after so long without a word a Tello lands by itself, so what is older held
/// nothing in the air. The launcher counts ends of link within as long.
inline constexpr TimeNs starts_within_ns = 15 * ns_per_s;

}  // namespace ledgerline::link
