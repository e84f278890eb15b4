#pragma once
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/process/usage.hpp"

namespace ledgerline::timing {

/// All threads of a flight's programs at one moment.
struct Snapshot {
  TimeNs t_ns = 0;
  HostUsage host;
  std::vector<ThreadUsage> threads;
};
Snapshot read_snapshot(const std::map<std::string, pid_t>& programs);

/// What fly writes into the run's folder: at the beginning of the flight with `end` as `begin`, once more at its end.
struct UsageRecord {
  std::map<std::string, pid_t> programs;
  Snapshot begin, end;
};
inline constexpr const char* usage_file = "usage.json";
nlohmann::json to_json(const UsageRecord& record);
Result<UsageRecord> usage_from_json(const std::string& text);

/// What two cores have to give, and what the flight takes of it. Percent of one core.
inline constexpr double budget_percent = 200;
struct ThreadLoad {
  ThreadUsage who;  ///< its counters are those of the measured time alone
  double cpu_percent = 0;
};
struct Load {
  double seconds = 0;                      ///< 0: not measured
  std::vector<ThreadLoad> threads;         ///< most CPU first
  std::map<std::string, double> programs;  ///< percent; with what they started
  double host_percent = 0;                 ///< of all that runs on this machine
  double steal_s = 0;
  double used_percent() const;
  double headroom_percent() const { return budget_percent - used_percent(); }
};
/// What was done between two snapshots. A thread that began between them counts whole; one that ended does not.
Load load_between(const Snapshot& begin, const Snapshot& end);

}  // namespace ledgerline::timing
