#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hil/fault/compare/comparison.hpp"
#include "hil/fault/run/run.hpp"

// Results of runs, as people and programs read them.
namespace ledgerline::hil {

/// "  broke at 12.345 s: RULE: what was seen", a line for each.
std::string broken_text(const RunResult& result);

/// "  not checked: RULES (WHY)" and "  not checked: WHAT", a line for each.
std::string not_checked_text(const RunResult& result);

using RunSummary = comparing::FlownRun;
RunSummary summary_of(const RunResult& result, const std::string& source);
/// Short, the same for the same text of a script.
std::string source_of(std::string_view script_text);

/// What was asked for and has no result.
struct NotFlown {
  std::string script;
  std::optional<std::uint64_t> seed{};  ///< none: not with any
  std::string why;
  bool error = true;         ///< else it was passed over: it needs another mode
  bool interrupted = false;  ///< it stands for all that was not flown any more
};

/// One JSON object: `runs`, with the events but without the timeline, and `figures` of `all`, a line each;
/// `not_flown` has no metrics; `interrupted`: not all was flown.
std::string json_text(const std::vector<RunResult>& results, const std::vector<RunSummary>& all,
                      const std::vector<NotFlown>& not_flown = {});
/// As CI systems read it: a testcase for each run of `all`; what was seen is reported for those in `results`.
/// What was not flown is an error, or skipped.
std::string junit_text(const std::vector<RunResult>& results, const std::vector<RunSummary>& all,
                       const std::vector<NotFlown>& not_flown = {});
/// One page with everything in it: each run's verdicts and timeline, by_rule() of `all`, and what was not flown.
std::string html_text(const std::vector<RunResult>& results, const std::vector<RunSummary>& all,
                      const std::vector<NotFlown>& not_flown = {});
/// A line for each run: script, seed, mode, held, flown_s, the broken rules, then each other metric.
std::string csv_text(const std::vector<RunSummary>& all);

/// In how many runs, and of how many scripts, a rule broke.
struct BrokenRule {
  std::string rule;
  std::size_t runs = 0, scripts = 0;
};
/// Those that broke, in most runs first.
std::vector<BrokenRule> by_rule(const std::vector<RunSummary>& all);
/// "  12 runs of 3 scripts broke: RULE", a line for each.
std::string by_rule_text(const std::vector<RunSummary>& all);

/// "1 drone", "2 drones".
std::string counted(std::size_t count, std::string_view what);

}  // namespace ledgerline::hil
