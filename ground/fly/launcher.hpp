#pragma once
#include <atomic>
#include <map>
#include <string>
#include <vector>

#include "common/process/children.hpp"
#include "ground/fly/configs.hpp"
#include "ground/fly/live.hpp"
#include "ground/fly/options.hpp"

namespace ledgerline::fly {

/// How a run went, as the launcher saw it.
struct RunRecord {
  bool ok = false;
  std::string why;                  ///< when not ok
  TimeNs begin_ns = 0, end_ns = 0;  ///< of the flight: all programs serve, until ground ended
  std::map<std::string, double> cpu_percent;
  std::map<std::string, double> memory_mb;  ///< proportional set size, as last seen
  std::uint64_t ledger_grown_bytes = 0;     ///< of the ledger's directory, during the flight
};

/// Starts the programs of a flight, watches them, and ends every one of them, whatever happens:
///
///     roudi, ledger, sim  ->  enroll, acquire  ->  link, agent, ground  ->  ground ends  ->  agent, link, sim, ledger,
///     roudi
///
/// `interrupts` counts Ctrl-C: the first one lands the drones, a second one does not wait for that.
class Launcher {
 public:
  Launcher(Options options, RunFiles files, std::string programs, bool terminal, const std::atomic<int>& interrupts);

  RunRecord run();

 private:
  Status start_all();
  Status start(const std::string& name, std::vector<std::string> arguments);
  Status wait_ready(const std::vector<std::string>& names);
  Status run_to_end(const std::string& name, std::vector<std::string> arguments);
  Status fly();
  void stop_all(bool landed);
  void take_line(const std::string& name, const std::string& line);
  std::string crash_of(const std::string& name, const std::string& when) const;
  std::string ground_why() const;

  Options options_;
  RunFiles files_;
  std::string programs_;
  const std::atomic<int>& interrupts_;
  Live live_;
  Children children_;
  std::map<std::string, std::string> ready_;  ///< the line that a program said it serves with
  RunRecord record_;
  std::map<std::string, double> cpu_at_begin_;
  const std::string ledger_;                     ///< the process that is the ledger: node or fabric
  const std::vector<std::string> all_programs_;  ///< that live through the flight
};

}  // namespace ledgerline::fly
