#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/process/children.hpp"
#include "hil/fault/real/live_facts.hpp"
#include "hil/fault/real/machine.hpp"
#include "hil/fault/real/real_script.hpp"
#include "hil/fault/real/replay.hpp"

namespace ledgerline::hil {

/// Does a script's faults to a flight of real processes when their moments come: commands the proxy, signals processes,
/// burns cores. Moments are of CLOCK_MONOTONIC; 0: not yet. One thread.
class RealFaults {
 public:
  struct Where {
    std::string programs;   ///< directory of the programs
    std::string directory;  ///< for logs of what it starts
    std::string run;        ///< with the proxy's faults.sock, the shim's shim.sock and operator.toml
    std::string parent;     ///< the child whose descendants processes are
    RealStack stack;
  };
  struct Planned {
    Fault fault;
    std::vector<std::size_t> drones;
    TimeNs reached_ns = 0, begun_ns = 0, ended_ns = 0;
    bool begin_asked = false, stop_requested = false;  ///< an errand may still be on its way
  };

  /// `live` and `children` must outlive it; lines that children print come by take_line().
  RealFaults(const Script& script, Where where, const LiveFacts& live, Children& children);

  void take_line(const std::string& name, const std::string& line) { lines_[name] += line + "\n"; }
  /// To be called repeatedly while the flight goes on. The error says which fault could not be done.
  Status step(TimeNs now);
  /// What outlives no flight.
  void end();

  const std::vector<Planned>& planned() const { return planned_; }
  /// Those that began, for the recording.
  std::vector<Recording::Fault> begun() const;
  const std::set<std::string>& killed_parts() const { return killed_parts_; }  ///< of Fabric's network

 private:
  /// Something that another program has to do or to say, while the flight is watched.
  struct Task {
    std::string name;
    std::vector<std::string> command;
    std::function<Status(const std::string& said)> then;
    TimeNs until_ns = 0;  ///< 0: not begun
  };
  Status step_faults(TimeNs now);
  bool due(const Planned& planned, TimeNs now) const;
  std::vector<Fault> active(const Planned* without) const;
  Status act(const RealActs& acts, bool begin, const std::function<void()>& acted);
  void signal_parts(const std::vector<std::pair<std::string, int>>& parts, TimeNs until,
                    const std::function<void()>& signalled);
  Status run_errands(TimeNs now);

  Where where_;
  int drones_;
  const LiveFacts& live_;
  Children& children_;
  std::vector<Planned> planned_;
  std::map<std::string, std::string> lines_;  // of errands
  std::deque<Task> errands_;                  // at most two a fault
  std::set<std::string> killed_parts_;
  std::map<int, std::unique_ptr<CpuLoad>> burners_;
  std::multimap<std::uint64_t, std::vector<char>> memory_;  // by size
};

}  // namespace ledgerline::hil
