#pragma once
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tools/bench/figures.hpp"

/// What became of the intents, and what the runs say together. No I/O.
namespace ledgerline::utm {

/// How a registration ends.
enum class End {
  registered,  ///< valid in a block
  refused,     ///< by the contract: the airspace is taken
  lost,        ///< neither: an error, conflicts until it was given up, or no end in time
};

/// One contender at one rate on one ledger's settings, once. Of the measured intents alone.
struct Turn {
  std::string contender, settings;
  int rate = 0, alternation = 0, position = 0;
  std::uint64_t submitted = 0, registered = 0, refused = 0;
  std::uint64_t conflicts = 0;     ///< transactions invalid by MVCC (11)
  std::uint64_t retried = 0;       ///< intents that were sent again, at least once
  std::vector<double> times_ms{};  ///< of those registered: from the first call until it is told to be valid in a block
  std::vector<double> refused_ms{};
  double length_s = 0;  ///< from the first measured call to the last measured end
  bool timed_out = false;
  std::string why{};  ///< what a client complained of last

  std::uint64_t lost() const { return submitted - registered - refused; }
  double registered_per_s() const { return length_s > 0 ? static_cast<double>(registered) / length_s : 0; }
  void count(End end, int attempts, std::uint64_t mvcc, double ms);
};

/// Nearest rank; nothing of nothing.
std::optional<double> quantile(std::vector<double> values, double q);

/// All alternations of a contender at a rate.
struct Figures {
  std::string contender, settings;
  int rate = 0, runs = 0;
  std::uint64_t submitted = 0, registered = 0, refused = 0, retried = 0, conflicts = 0, lost = 0;
  std::optional<two_way::Spread> p50_ms{}, p95_ms{}, p99_ms{}, refused_p50_ms{}, registered_per_s{};
  /// p50 divided by `gateway`'s, within each alternation.
  std::optional<two_way::Spread> p50_of_gateway{};
};
std::vector<Figures> summarize(const std::vector<Turn>& runs);

std::string to_table(const std::vector<Figures>& figures);
nlohmann::json to_json(const Turn& run);
nlohmann::json to_json(const std::vector<Figures>& figures);

}  // namespace ledgerline::utm
