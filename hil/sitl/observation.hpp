#pragma once
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "common/base/enum_count.hpp"
#include "ground/core/flight.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil {

inline constexpr double on_ground_m = 0.1;  ///< a drone below it, its motors off, is on the ground
inline constexpr double rc_full_mps = 1;    ///< what rc 100 means in fault runs: no script sets full_scale_mps

/// Whether it is there, motors off: one whose motors were cut may still be falling.
inline bool on_ground(const sim::Truth& truth) { return !truth.in_flight && truth.position_m[2] < on_ground_m; }

/// A drone that somebody else than ground flies is on its way: high enough to have left the ground behind.
inline bool on_course(const sim::Truth& truth) { return truth.in_flight && truth.position_m[2] > 0.5; }

inline double length_of(const std::array<double, 3>& v) { return std::hypot(v[0], v[1], v[2]); }
inline double distance_m(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

enum class Process : std::uint8_t { agent, link, ground };
inline constexpr std::size_t process_count = enum_count<Process>;
/// "agent", "link", "ground".
inline std::string name_of(Process process) {
  return std::string(enum_names<Process>[static_cast<std::size_t>(process)]);
}

/// What a run is checked by: one drone at one moment. What link, agent and ground say is as they say it; the truth is
/// the simulator's.
struct DroneObservation {
  std::string name;
  DroneNumber number = 0;
  sim::Truth truth;
  LinkPhase phase = LinkPhase::disconnected;
  FailsafeMode mode = FailsafeMode::none;
  FailsafeCause cause = FailsafeCause::none;
  double sent_mps = 0;            ///< horizontal and vertical speed of the newest rc, together
  std::array<double, 3> sent{};   ///< the same as a velocity of the map frame, by link's estimate of the yaw [m/s]
  TimeNs sent_ns = 0;             ///< when it was sent; 0: never
  TimeNs sent_until_ns = 0;       ///< end of the newest plan that link was given, as it says; 0: none
  TimeNs land_until_ns = 0;       ///< of a landing that waits for room below (SeparationSettings); 0: none does
  TimeNs made_room_ns = 0;        ///< when its failsafe made room for another last, which link steers without a plan
  TimeNs plan_end_ns = 0;         ///< the latest of these three, the plan's by playout's margin now; 0: none
  std::uint64_t plans_given = 0;  ///< FLY plans that link was given
  std::optional<Pose> pose;       ///< newest that link was given, or estimated by onboard odometry
  ground::GroundPhase ground_phase = ground::GroundPhase::waiting;
  bool finished = false;
  int lap = 0;                                   ///< 0 before the path
  std::optional<double> off_path_m;              ///< on its path: distance of the truth from it
  std::array<double, 2> start_m{};               ///< where it stood
  std::vector<std::array<double, 2>> corners{};  ///< of its path, on the map, each once; the first is where it stood
  int laps = 1;                                  ///< that it has to fly
};

/// What happened at one moment.
struct WorldEvent {
  enum class Kind {
    mode,       ///< link's phase, mode or cause changed; the observations have them
    handed,     ///< agent handed a command on to link: `sequence`
    applied,    ///< a plan's first setpoint was sent: `sequence`; `value` is its age [s]
    sent,       ///< a command that is no rc went to the drone: `text`
    bad_rc,     ///< an rc that the SDK would not take: `text`
    started,    ///< a process: `text`
    ended,      ///< the same
    fault,      ///< begins or ends: `text`
    untrusted,  ///< agent does not trust the ledger: `text`
    unasked,    ///< something is flown or shown that nobody signed: `text`
  };
  TimeNs t_ns = 0;
  Kind kind{};
  std::size_t drone = 0;  ///< index; of a process 0
  double value = 0;
  std::string text{};
  std::uint64_t sequence = 0;  ///< of the plan; 0: not known
};

}  // namespace ledgerline::hil
