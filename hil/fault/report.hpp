#pragma once
#include <string>
#include <vector>

#include "hil/fault/run/result.hpp"

// Results of runs, as people and programs read them.
namespace ledgerline::hil {

/// "  broke at 12.345 s: RULE: what was seen", a line for each.
std::string broken_text(const RunResult& result);

/// "  not judged: WHAT", a line for each.
std::string not_judged_text(const RunResult& result);

/// One JSON object, with the events; the timeline is left out.
std::string json_text(const std::vector<RunResult>& results);
/// As CI systems read it: a testcase for each run.
std::string junit_text(const std::vector<RunResult>& results);
/// One page with everything in it: each run's verdicts and timeline.
std::string html_text(const std::vector<RunResult>& results);

}  // namespace ledgerline::hil
