#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "hil/virtual/world.hpp"

namespace ledgerline::hil {

/// A number with its unit: "300 ms", "6s", "3 m", "0.5 m/s". Times are in seconds.
struct Amount {
  enum class Unit : std::uint8_t { time, metres, speed };
  double value = 0;
  Unit unit{};
};
std::optional<Amount> parse_amount(std::string_view text);

/// What must hold, as a sentence; docs/faults.md lists them. Those that count from a fault count from the first one's
/// beginning, or from the last one's end.
struct Rule {
  enum class Kind : std::uint8_t {
    finishes,         ///< finishes
    recovers,         ///< recovers and finishes the lap: after the last fault's end each drone flew its plan again
    hold_after_plan,  ///< hold within 300 ms after the plan's end
    reacts,           ///< hold|brake|land within 1 s
    lands,            ///< lands within 6 s: on the ground; these two of every drone that the first fault names
    resumes,          ///< resumes within 2 s: after the last fault's end
    seen,             ///< hold is seen; cause pose lost is seen
    never_seen,       ///< land is never seen
    command_age,      ///< no command older than 500 ms applied
    height,           ///< height below 3 m
    speed,            ///< speed below 1.5 m/s
    path,             ///< path within 0.4 m
    estimate,         ///< pose within 0.2 m: what link believes, of the truth
    nothing_lost,     ///< nothing acknowledged is lost
    ends,             ///< ends within 60 s
    sent,             ///< sends emergency; sends no emergency
    no_crash,         ///< no crash
    transactions,     ///< at most 70 transactions a second: on average
    fence,            ///< fence kept within 0.2 m: the truth is nowhere farther beyond it
  };
  Kind kind{};
  std::string text;
  std::optional<FailsafeMode> mode{};    ///< reacts, seen, never_seen
  std::optional<FailsafeCause> cause{};  ///< seen, never_seen
  double amount = 0;                     ///< s, m or m/s
  std::string command;                   ///< sent: what; `negated`: never
  bool negated = false;
  bool always = false;  ///< an invariant of every run, not of this script

  bool needs_fault_end() const { return kind == Kind::resumes || kind == Kind::recovers; }
  bool needs_fault() const { return kind == Kind::reacts || kind == Kind::lands || needs_fault_end(); }
};
/// The error says which sentences there are.
Result<Rule> parse_rule(std::string_view sentence);
/// All kinds of sentences, one a line, for help and errors.
std::string rule_help();

/// What a run looks like to the judge at one moment, besides the drones.
struct Moment {
  TimeNs now = 0;
  std::span<const DroneFacts> drones;
  std::span<const WorldEvent> events;
  bool link_runs = true;  ///< alive and not stopped
  /// By drone, empty: for none: limits that say nothing now.
  struct Excuse {
    bool physical = false;  ///< it was broken or pushed: speed, height and place are not the flight's own
    bool deaf = false;      ///< nobody tells it anything, or it may not get there: it goes by what it heard last
  };
  std::span<const Excuse> excuses{};
  std::optional<TimeNs> first_fault_ns, last_fault_end_ns;
  std::span<const std::size_t> first_fault_drones{};  ///< indices of those that the first fault names; empty: all
};

/// How one run ended, for what is judged at its end.
struct Ending {
  TimeNs now = 0;
  bool over = false;  ///< by itself, not by the limit
  bool ok = false;    ///< every drone finished its path and landed
  std::string why;
  std::vector<std::string> in_the_air;  ///< drones
  std::vector<std::string> missing{};   ///< faults of the script that never began, in words
  std::uint64_t transactions = 0;       ///< on the ledger
  std::vector<std::string> lost{};      ///< acknowledged transactions and transitions that are not on the ledger
  std::vector<std::string> crashed{};   ///< programs that ended though nobody asked for it, in words
};

struct Verdict {
  Rule rule;
  bool held = true;
  TimeNs broken_ns = 0;  ///< when it broke
  std::string what;      ///< what was seen instead
};

/// Limits of the always-on invariants.
struct Limits {
  double speed_mps = 2.6;  ///< link's limit of 2 m/s horizontally, 1 m/s vertically, and what wind and lag add
  double height_m = 3.6;   ///< the fence is at 3 m
  std::array<double, 2> min_m{-100, -100}, max_m{100, 100};
  std::array<double, 3> fence_min_m{-100, -100, 0}, fence_max_m{100, 100, 3};  ///< the fence itself
  double told_mps2 = 4.4;  ///< link's limit of 4 m/s2, and what rounding adds; a brake has twice as much
};

/// Judges a run moment by moment: the script's rules, and the invariants of every run:
///
///     speed, height, distance   never beyond the limits, but of a drone that was pushed, broken or deafened, until 5 s
///                               behind that fault's end (1 s behind the start of a link that was away); where it got
///                               meanwhile it may stay, but no farther than 0.5 m on
///     unseen                    a drone in the air that a running link does not see stands still after 1 s, and is
///                               down after 25 s: whatever became of the link before
///     hold after silence        300 ms after the newest plan's end link holds, brakes or lands, and 0.6 s later it
///                               tells the drone zero
///     landing after a hold      a hold or brake of land_after (5 s) and 0.5 s more is a landing
///     rc in range               as the SDK takes it
///     ramps                     what the drone is told changes no faster than the limit of acceleration, but for a
///                               link that stood still
///     commands in order         agent hands each one on once, link flies from each one once, none after a newer one
///     a brake takes its plans   after it nothing is flown before another plan came
///     down in the end           when the run is over, or its time is up, nothing is in the air
///     no hang                   it is over before its time is up
///     every fault began         of the script, but those that are optional: otherwise the run says nothing about it
///     nothing unasked           what agent hands on is in a call that its creator signed, and what ground flies by is
///                               what link said
///     nothing is lost           that was acknowledged as committed; transitions have no gap
///
/// Plain data in, verdicts out. One thread.
class Judge {
 public:
  Judge(const std::vector<Rule>& rules, const Limits& limits);

  /// After each step of the world.
  void look(const Moment& moment);
  /// After the last one.
  std::vector<Verdict> finish(const Ending& ending);

  static constexpr TimeNs hold_within_ns = 300 * ns_per_ms;
  static constexpr TimeNs ramp_ns = 600 * ns_per_ms;  ///< from 2 m/s at 4 m/s2, and a step of rc
  static constexpr double told_at_once_mps = 0.3;     ///< between two rc of a ramp, and their rounding
  static constexpr TimeNs land_after_ns = 5'500 * ns_per_ms;
  static constexpr double farther_m = 0.5;  ///< than where it got while it was deaf
  static constexpr TimeNs unseen_stops_ns = 1 * ns_per_s, unseen_down_ns = 25 * ns_per_s;
  static constexpr double unseen_mps = 0.4;  ///< horizontally: gusts, and how a Tello drifts

 private:
  struct Drone {
    TimeNs hovering_since_ns = 0;
    TimeNs unseen_since_ns = 0;    ///< in the air, and link runs but does not see it
    double high_m = 0, far_m = 0;  ///< beyond the limits: where it got while it was deaf
    bool flew = false;             ///< was higher than on_ground_m, in flight
    TimeNs rested_since_ns = 0;    ///< link runs and the drone flies, without a break
    std::array<double, 3> told{};
    double may_change_mps = 0;  ///< what it is told, now
    TimeNs looked_ns = 0;
    std::uint64_t handed = 0, applied = 0;  ///< newest sequences
    bool braked = false;
    std::uint64_t plans_at_brake = 0;  ///< that link had been given when it ended
  };
  struct State {
    Verdict verdict;
    bool seen = false;
    bool waits = false;      ///< a drone of the first fault is not yet `done`
    std::vector<bool> done;  ///< by drone
  };
  void look_at(const Moment& moment, State& state);          ///< one of the script's rules
  void look_after(const Moment& moment, std::size_t drone);  ///< the invariants, for one drone
  void look_at_limits(const Moment& moment, std::size_t drone);
  void look_at_unseen(const Moment& moment, std::size_t drone);
  void look_at_ramp(const Moment& moment, std::size_t drone, bool rested);
  void look_at_order(const Moment& moment);
  void look_at_brake(const Moment& moment, std::size_t drone, bool flies);
  static void broke(State& state, TimeNs now, std::string what);
  State& invariant(std::size_t which) { return states_[rules_ + which]; }

  Limits limits_;
  std::size_t rules_;
  std::vector<State> states_;  ///< the script's, then the invariants
  std::vector<Drone> drones_;
};

}  // namespace ledgerline::hil
