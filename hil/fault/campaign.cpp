#include "hil/fault/campaign.hpp"

#include <fmt/format.h>

#include <mutex>
#include <thread>

namespace ledgerline::hil {

void fly_all(std::size_t count, unsigned jobs, const std::function<Flight(std::size_t)>& make,
             const std::function<bool(std::size_t, const Flight&, Result<RunResult>)>& done) {
  std::mutex mutex;
  std::size_t next = 0;
  const auto work = [&] {
    std::unique_lock lock(mutex);
    while (next < count) {
      const std::size_t mine = next++;
      const Flight flight = make(mine);
      lock.unlock();
      Result<RunResult> result = run_script(flight.script, flight.seed);
      lock.lock();
      if (!done(mine, flight, std::move(result))) next = count;
    }
  };
  std::vector<std::jthread> threads;
  for (unsigned i = 1; i < jobs; ++i) threads.emplace_back(work);
  work();
}

Result<std::pair<std::uint64_t, std::uint64_t>> parse_seeds(const std::string& text) {
  const auto number = [](const std::string& digits) -> std::uint64_t {
    if (digits.empty() || digits.size() > 18 || digits.find_first_not_of("0123456789") != std::string::npos) return 0;
    return std::stoull(digits);
  };
  const auto dots = text.find("..");
  const std::uint64_t first = number(text.substr(0, dots));
  const std::uint64_t last = dots == std::string::npos ? first : number(text.substr(dots + 2));
  if (first == 0 || last < first)
    return Error{fmt::format("\"{}\": seeds must be a number from 1 on, or two with .. between, as in 1..1000", text)};
  return std::pair(first, last);
}

std::vector<Flight> flights_of(const std::vector<Script>& scripts,
                               const std::optional<std::pair<std::uint64_t, std::uint64_t>>& seeds) {
  std::vector<Flight> flights;
  for (const Script& script : scripts) {
    const std::uint64_t own = script.seed.value_or(1);
    const auto [first, last] = seeds.value_or(std::pair(own, own));
    for (std::uint64_t seed = first; seed <= last; ++seed) flights.push_back({script, seed});
  }
  return flights;
}

}  // namespace ledgerline::hil
