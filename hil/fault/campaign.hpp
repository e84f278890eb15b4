#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "hil/fault/run.hpp"

namespace ledgerline::hil {

struct Flight {
  Script script;
  std::uint64_t seed = 1;
};

/// Flies `count` scripts in `jobs` threads, each number once. `make` and `done` are called by one thread at a time;
/// `done` in the order in which flights end. A `done` that returns false ends the campaign behind the flights under
/// way.
void fly_all(std::size_t count, unsigned jobs, const std::function<Flight(std::size_t)>& make,
             const std::function<bool(std::size_t, const Flight&, Result<RunResult>)>& done);

/// "7" or "1..1000": the first and the last.
Result<std::pair<std::uint64_t, std::uint64_t>> parse_seeds(const std::string& text);

/// Each script with each seed from `seeds`; without seeds each with its own one, or 1.
std::vector<Flight> flights_of(const std::vector<Script>& scripts,
                               const std::optional<std::pair<std::uint64_t, std::uint64_t>>& seeds);

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
