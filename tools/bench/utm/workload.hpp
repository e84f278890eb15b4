#pragma once
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"

/// Registrations of operational intents, as UAS service suppliers (USS) ask for them (ASTM F3548). No I/O.
namespace ledgerline::utm {

struct WorkloadOptions {
  std::uint64_t seed = 1;
  double rate_per_s = 30;
  bool poisson = true;       ///< otherwise evenly
  double overlapping = 0.1;  ///< share of intents whose airspace an earlier intent has asked for
  double racing = 0.5;       ///< of those, the share that comes at the same moment as its rival
  int suppliers = 6;         ///< USS, of three organisations in turn
  double warm_up_s = 5, seconds = 20;
  std::string airspace = "utm";  ///< begins the cells' names: another one is free of earlier runs' intents
};

/// A part of space and time. Two volumes overlap if and only if they are in the same cell: each is well inside its own.
struct Cell {
  int x = 0, y = 0, layer = 0, slot = 0;
  bool operator==(const Cell&) const = default;
};

struct Intent {
  TimeNs at_ns = 0;       ///< after the start
  bool measured = false;  ///< otherwise warm-up
  bool overlaps = false;  ///< an earlier intent has asked for its cell
  Cell cell{};
  std::string airspace;  ///< the cell's name; its SHA-256 is the digest that is anchored
  std::string what;      ///< id, manager, state, priority, 4D volume; within contract::max_anchor_chars
};

/// The same options make the same intents, in order of at_ns.
std::vector<Intent> make_workload(const WorkloadOptions& options);

/// After an MVCC conflict: how long before the next attempt, and after how many it is given up.
struct RetryPolicy {
  int attempts = 6;
  double first_ms = 20, max_ms = 500;
  /// `attempt`: how many there were, from 1. `jitter`: from 0 to 1. At least half of the doubled pause.
  double pause_ms(int attempt, double jitter) const;
};

/// What the clients of all contenders are given, in whatever language they are.
struct Job {
  std::vector<Intent> intents{};
  RetryPolicy retry{};
  double drain_s = 10;
  std::uint64_t seed = 1;  ///< of the jitter
};
nlohmann::json to_json(const Job& job);
Result<Job> read_job(const std::string& text);

}  // namespace ledgerline::utm
