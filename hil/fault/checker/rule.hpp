#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "hil/fault/checker/moment.hpp"

namespace ledgerline::hil {

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
/// The error says which sentences there are.
Result<Rule> parse_rule(std::string_view sentence);
/// All kinds of sentences, one a line, for help and errors.
std::string rule_help();

/// Whether a rule held; the first time that it did not counts.
struct Verdict {
  Rule rule;
  bool held = true;
  TimeNs broken_ns = 0;  ///< when it broke
  std::string what;      ///< what was seen instead
  void broke(TimeNs now, std::string seen);
};

/// A rule at work.
struct RuleState {
  Verdict verdict;
  bool seen = false;
  bool waits = false;                 ///< a drone of the first fault is not yet `done`
  std::vector<bool> done{};           ///< by drone
  std::vector<std::size_t> counts{};  ///< by drone
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
  void (*observe)(RuleState&, const Sight&, std::size_t drone) = nullptr;  ///< each drone at each moment
  void (*hear)(RuleState&, const Moment&, const WorldEvent&) = nullptr;    ///< each event
  void (*finish)(RuleState&, const Ending&) = nullptr;                     ///< behind the last moment
  bool needs_fault = false;                                                ///< it counts from one's beginning
  bool needs_fault_end = false;                                            ///< from the last one's end
  bool needs_link = false;         ///< link, agent, ground or the ledger say it: a flight by the SDK has none
  std::string_view not_real = {};  ///< why it cannot be checked of the real processes' traces; empty: it can
};
std::span<const RuleKind> rule_kinds();
/// With an example of what it takes: "holds within 2 s".
std::string form_of(const RuleKind& kind);

}  // namespace ledgerline::hil
