#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "hil/sitl/observation.hpp"

namespace ledgerline::hil {

/// What a run looks like to the checker at one moment, besides the drones.
struct Moment {
  TimeNs now = 0;
  std::span<const DroneObservation> drones;
  std::span<const WorldEvent> events;
  bool link_runs = true;  ///< alive and not stopped
  /// By drone, empty: for none: limits that say nothing now.
  struct Excuse {
    bool physical = false;  ///< it was broken or pushed: speed, height and place are not the flight's own
    bool broken = false;    ///< a fault took a part of it: it may turn over
    bool cut = false;       ///< somebody asked for its motors to be cut
    bool blind = false;     ///< its own velocity is lost: it cannot know how far it goes, but physics bounds that
    bool misled = false;    ///< what it says of its own motion may be wrong
    bool steered = false;   ///< blind, and motion capture steers it all the same
    bool spins = false;     ///< broken and spinning: its pose is older than the heading that rc was computed for
    bool deaf = false;      ///< it is sent nothing, or it may not get there: it goes by what it heard last
  };
  std::span<const Excuse> excuses{};
  std::optional<TimeNs> first_fault_ns, last_fault_end_ns;
  std::span<const std::size_t> first_fault_drones{};  ///< indices of those that the first fault names; empty: all
};

/// What a run shows to the checker. Each has what those before it have.
enum class Evidence : std::uint8_t {
  truth,      ///< where the drones were: a flight by the SDK
  traces,     ///< and what the traces of the real processes tell
  simulation  ///< everything
};

/// How one run ended, for what is checked at its end.
struct Ending {
  TimeNs now = 0;
  bool over = false;  ///< by itself, not by the limit
  bool ok = false;    ///< every drone finished its path and landed
  std::string why{};
  std::vector<std::string> in_the_air{};  ///< drones
  std::vector<std::string> missing{};     ///< faults of the script that never began, in words
  std::uint64_t transactions = 0;         ///< on the ledger
  std::vector<std::string> lost{};        ///< acknowledged transactions and transitions that are not on the ledger
  std::vector<std::string> crashed{};     ///< programs that ended though nobody asked for it, in words
  Evidence evidence = Evidence::simulation;
  bool lost_is_known = true;  ///< else `lost` may lack some: who counts them was killed
};

/// Limits of the always-on invariants.
struct Limits {
  double speed_mps = 2.6;  ///< link's limit of 2 m/s horizontally, 1 m/s vertically, and what wind and lag add
  double height_m = 3.6;   ///< the fence is at 3 m
  std::array<double, 2> min_m{-100, -100}, max_m{100, 100};
  std::array<double, 3> fence_min_m{-100, -100, 0}, fence_max_m{100, 100, 3};  ///< the fence itself
  double sent_mps2 = 4.4;  ///< link's limit of 4 m/s2, and what rounding adds; a brake has twice as much
};

/// A number with its unit: "300 ms", "6s", "3 m", "0.5 m/s". Times are in seconds.
struct Amount {
  enum class Unit : std::uint8_t { time, metres, speed };
  double value = 0;
  Unit unit{};
};
std::optional<Amount> parse_amount(std::string_view text);

struct RuleKind;

/// What must hold, as a sentence; docs/faults.md lists them. Those that count from a fault count from the first one's
/// beginning, or from the last one's end.
struct Rule {
  const RuleKind* kind = nullptr;  ///< nothing: an invariant, which Invariants checks
  std::string text;
  bool always = false;  ///< demanded of every run, or of every script that does not say otherwise
  // What stands for {} in the kind's form.
  double amount = 0;  ///< s, m or m/s
  std::optional<FailsafeMode> mode{};
  std::optional<FailsafeCause> cause{};
  std::string command{};
};
/// The error says which sentence may be meant.
Result<Rule> parse_rule(std::string_view sentence);
/// All kinds of sentences, one a line, for help.
std::string rule_help();

/// Whether a rule held; the first time that it did not counts.
struct Verdict {
  Rule rule;
  bool held = true;
  TimeNs broken_ns = 0;  ///< when it broke
  std::string what;      ///< what was seen instead
  /// Why nothing showed whether it held; empty: it was checked.
  std::string not_checked{};
  bool was_checked() const { return not_checked.empty(); }
  void broke(TimeNs now, std::string seen);
};
/// Of what is demanded of every run: it held so far.
Verdict always(std::string_view text);

/// A rule at work.
struct RuleState {
  /// What a limit was broken by: at first, and by whom the most until the end.
  struct Excess {
    double first = 0, worst = 0;
    std::string drone;
    std::string_view unit;
  };
  Verdict verdict;
  std::optional<Excess> excess{};
  bool seen = false;
  bool waits = false;                 ///< a drone of the first fault is not yet `done`
  std::optional<TimeNs> from_ns{};    ///< what its time counts from; nothing: that was not yet
  std::vector<bool> done{};           ///< by drone
  std::vector<std::size_t> counts{};  ///< by drone
  struct Hover {
    std::optional<TimeNs> since_ns{};
    std::optional<std::array<double, 3>> place_m{};
  };
  std::vector<Hover> hovers{};  ///< by drone
  bool all_done() const;
};

/// What rules see of one moment.
struct Sight {
  const Moment& moment;
  const Limits& limits;
  const std::vector<bool>& flew;  ///< by drone: before this moment
};

/// A kind of rule: a row of the table in rules.cpp.
struct RuleKind {
  enum class Takes : std::uint8_t { nothing, time, metres, speed, number, mode_or_cause, command };
  std::string_view form;  ///< {} stands for what it takes
  Takes takes = Takes::nothing;
  std::string_view help;
  // Functions that are null see nothing.
  void (*observe)(RuleState&, const Sight&, std::size_t drone) = nullptr;    ///< each drone at each moment
  void (*on_event)(RuleState&, const Moment&, const WorldEvent&) = nullptr;  ///< each event
  void (*finish)(RuleState&, const Ending&) = nullptr;                       ///< behind the last moment
  bool needs_fault = false;                                                  ///< it counts from one's beginning
  bool needs_fault_end = false;                                              ///< from the last one's end
  bool needs_lost = false;                                                   ///< Ending::lost, and all of it
  bool needs_link = false;         ///< link, agent, ground or the ledger say it: a flight by the SDK has none
  std::string_view not_real = {};  ///< why it cannot be checked of the real processes' traces; empty: it can
};
std::span<const RuleKind> rule_kinds();
/// With an example of what it takes: "holds within 2 s".
std::string form_of(const RuleKind& kind);

}  // namespace ledgerline::hil
