#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "hil/fault/run/run.hpp"

namespace ledgerline::hil {

struct Flight {
  Script script;
  std::uint64_t seed = 1;
};

/// Flies `count` scripts in `jobs` threads, each number once. `make` and `done` are called by one thread at a time;
/// `done` in the order in which flights end. A `done` that returns false ends the campaign after the flights in
/// progress.
void fly_all(std::size_t count, unsigned jobs, const std::function<Flight(std::size_t)>& make,
             const std::function<bool(std::size_t, const Flight&, Result<RunResult>)>& done);

/// "7" or "1..1000": the first and the last.
Result<std::pair<std::uint64_t, std::uint64_t>> parse_seeds(const std::string& text);

/// Each script with each seed from `seeds`; without seeds each with its own one, or 1.
std::vector<Flight> flights_of(const std::vector<Script>& scripts,
                               const std::optional<std::pair<std::uint64_t, std::uint64_t>>& seeds);

}  // namespace ledgerline::hil
