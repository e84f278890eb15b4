#pragma once
#include <array>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "common/msg/onboard.hpp"

/// Every threshold of link's cores, with its default. The shell reads them from TOML (link_config.hpp); hil and tests
/// fill them in directly.
namespace ledgerline::link {

struct SessionSettings {
  TimeNs answer_timeout_ns = 500 * ns_per_ms;  ///< first try of `command`; doubles with each further one
  TimeNs answer_timeout_max_ns = 4 * ns_per_s;
  TimeNs takeoff_timeout_ns = 10 * ns_per_s;     ///< clients wait 20 s (djitellopy); a real take-off takes about 4 s
  TimeNs refused_pause_ns = 2 * ns_per_s;        ///< after a refused take-off, before the next may be tried
  TimeNs land_repeat_ns = 1 * ns_per_s;          ///< land is sent again while the drone does not come down
  TimeNs lost_after_ns = 3 * ns_per_s;           ///< on the ground, without state text: disconnected
  TimeNs landing_lost_after_ns = 30 * ns_per_s;  ///< landing, with neither answer nor state text: disconnected
  /// Seen on the ground without a break for so long it stands there: a shorter sight may be of a take-off that a link
  /// began which is gone, whose motors spin up for a second or two before it rises.
  TimeNs stands_after_ns = 3 * ns_per_s;
  /// To a drone that is not seen and may fly (blind_talk.hpp). So many `command`, at 0, 0.5 and 1.5 s, all given up 3.5
  /// s after the first: a state text comes every 100 ms, an answer within tens of ms. One would end a flight for one
  /// datagram that is lost; with six a drone that hears but is not heard hovers for 15.5 s before it is landed.
  int handshakes = 3;
  TimeNs zero_gap_ns = 100 * ns_per_ms;  ///< between two zeros meanwhile: with 60 % lost, 92 % hear one of five
  /// Between two `land` (or `emergency`), each behind a `command` and a zero: twice as often as where it is seen
  /// whether the drone obeys.
  TimeNs blind_repeat_ns = 500 * ns_per_ms;
  /// So long: longer than a take-off, during which `land` is ignored (4 s); with 60 % lost, 99.8 % hear one of twelve.
  TimeNs blind_land_for_ns = 6 * ns_per_s;
  /// Then nothing at all, longer than the 15 s after which a Tello lands by itself, and that by what the network may
  /// hold back. Shorter would hold a drone in the air that hears everything but `land`; longer makes whoever switches a
  /// drone on behind link wait for as long (ground waits 30 s for a drone).
  TimeNs silence_ns = 16 * ns_per_s;
  /// The same word, when link ends and a drone was never heard of: mostly there is none, and a person waits. 7 times.
  TimeNs unheard_land_for_ns = 3 * ns_per_s;
  /// Starts of link within starts.hpp's 15 s, of which the last one tells every drone to land in its first step: who
  /// dies so often cannot fly, and each life's first words are a sign of life to a Tello. The launcher gives up with as
  /// many.
  int many_starts = 7;
  float airborne_m = 0.25F;  ///< `h` comes in steps of 0.1 m
  float grounded_m = 0.15F;  ///< tof shows 0.10 m on the ground
};

struct PlayoutSettings {
  TimeNs max_age_ns = 2 * ns_per_s;          ///< a FLY or TAKEOFF plan made from an older state is dropped
  TimeNs max_ahead_ns = 5 * ns_per_s;        ///< a setpoint further in the future is a bad value
  TimeNs default_hold_ns = 100 * ns_per_ms;  ///< how long the only setpoint of a plan is valid
  TimeNs max_hold_ns = 500 * ns_per_ms;      ///< how long the last setpoint of any plan is valid, at most
  TimeNs max_margin_ns = 1 * ns_per_s;       ///< setpoints are flown later than they say by so much at most; 0: never
  double margin_quantile = 0.98;             ///< of the plans' lateness: so many are to come in time
  float max_speed_mps = 2.0F;                ///< of the horizontal velocity
  float max_vertical_mps = 1.0F;
  float max_yaw_rate_radps = 1.75F;
  float max_acceleration_mps2 = 4.0F;  ///< of the whole velocity vector; also the ramp to zero
  float max_yaw_acceleration_radps2 = 6.0F;
};

struct RcSettings {
  float full_scale_mps = 1.0F;  ///< what rc 100 means; not documented, clients call it cm/s
  float full_scale_radps = 100.0F * std::numbers::pi_v<float> / 180.0F;
  /// From (left, forward, up, counter-clockwise) to rc (a, b, c, d). rc a positive is right, d positive is clockwise.
  std::array<float, 4> signs{-1, 1, 1, -1};
  TimeNs min_gap_ns = 5 * ns_per_ms;        ///< between any two rc
  TimeNs changing_gap_ns = 20 * ns_per_ms;  ///< while the setpoint is ramped
  TimeNs max_gap_ns = 50 * ns_per_ms;       ///< while flying, an rc is never further apart
};

struct FailsafeSettings {
  TimeNs hold_grace_ns =
      100 * ns_per_ms;                  ///< from the end of the plan until the mode says hold (the ramp begins at once)
  TimeNs land_after_ns = 5 * ns_per_s;  ///< of hold or brake, then land
  TimeNs agent_silent_ns = 500 * ns_per_ms;
  TimeNs state_stale_ns = 1 * ns_per_s;  ///< the Tello's state text comes at 10 Hz
  TimeNs pose_lost_ns = 300 * ns_per_ms;
  TimeNs clear_after_ns = 500 * ns_per_ms;    ///< a brake ends when its cause has been away this long
  TimeNs fence_land_after_ns = 1 * ns_per_s;  ///< beyond the fence and still going outward
  float battery_low = 0.15F;
  float battery_critical = 0.08F;
  float battery_margin = 0.03F;  ///< a low battery is forgotten only above the threshold by this
};

struct FenceSettings {
  std::array<double, 3> min_m{-20, -20, 0};
  std::array<double, 3> max_m{20, 20, 3};
  double slow_s = 0.7;       ///< outward speed is at most the distance to the fence over this
  double outward_mps = 0.1;  ///< beyond the fence, faster outward than this counts as still going outward
  double far_beyond_m = 1;   ///< beyond the fence by this counts as still going outward, at any speed
};

struct DroneSettings {
  std::string name;
  DroneNumber number = 0;
};

struct LinkSettings {
  std::vector<DroneSettings> drones;
  double rate_hz = 30;                     ///< of state samples
  TimeNs health_gap_ns = 250 * ns_per_ms;  ///< between two steps; a longer one means that link is not healthy ...
  TimeNs health_rest_ns =
      1 * ns_per_s;  ///< ... for this long: no rc, so that a link that stutters lets the Tello land itself
  SessionSettings session;
  PlayoutSettings playout;
  RcSettings rc;
  FailsafeSettings failsafe;
  FenceSettings fence;
};

}  // namespace ledgerline::link
