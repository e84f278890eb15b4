#pragma once
#include <sys/types.h>

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/result.hpp"
#include "common/process/children.hpp"
#include "common/rt/trace.hpp"
#include "hil/fault/kinds/fault.hpp"
#include "hil/fault/real/replay.hpp"
#include "hil/fault/script.hpp"

// What faults do to the machine that a flight of the real processes runs on.

namespace ledgerline::hil {

/// A trace that grows, and starts again when its program does.
class GrowingTrace {
 public:
  explicit GrowingTrace(std::string path) : path_(std::move(path)) {}
  /// What is new; nothing while there is no file.
  std::vector<TraceRecord> read_new();

 private:
  std::string path_;
  std::unique_ptr<TraceReader> reader_;
  ino_t inode_ = 0;
};

/// What triggers look at, as far as the traces in the folder of a flight show it while they grow. One thread.
class LiveObservation {
 public:
  LiveObservation(const std::string& run, const Script& script);
  void read();
  const std::vector<DroneObservation>& drones() const { return drones_; }
  TimeNs begin_ns() const { return begin_ns_; }  ///< link's first record; 0: none yet

 private:
  DroneObservation* of(const TraceRecord& r) {
    return r.drone >= 1 && r.drone <= drones_.size() ? &drones_[r.drone - 1u] : nullptr;
  }
  GrowingTrace sim_, link_, ground_;
  bool by_sdk_;                ///< neither link nor ground
  std::vector<double> lap_m_;  ///< by drone
  std::vector<DroneObservation> drones_;
  TimeNs begin_ns_ = 0;
};

/// Processes whose program has this name, among the descendants of `parent`.
std::vector<pid_t> descendants(pid_t parent, const std::string& program);

/// Makes a file that leaves no byte of the disk.
Status fill(const std::string& path);

/// Computes on one core until it goes.
class CpuLoad {
 public:
  explicit CpuLoad(int core);
  bool pinned() const { return pinned_; }

 private:
  std::jthread thread_;
  bool pinned_ = false;
};

/// A small disk of this process and those that it starts, until this object's end.
class SmallDisk {
 public:
  SmallDisk() = default;
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  ~SmallDisk();
  Status mount(const std::string& directory);

 private:
  std::string directory_;
};

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
    TriggerWatch watch;
    TimeNs begun_ns = 0, ended_ns = 0;
    bool begin_asked = false, stop_requested = false;  ///< a task may still be on its way
  };

  /// `live` and `children` must outlive it; lines that children print come by add_line().
  RealFaults(const Script& script, Where where, const LiveObservation& live, Children& children);

  void add_line(const std::string& name, const std::string& line) { lines_[name] += line + "\n"; }
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
  std::vector<Fault> active(const Planned* without) const;
  Status act(const RealActs& acts, bool begin, const std::function<void()>& acted);
  void signal_parts(const std::vector<std::pair<std::string, int>>& parts, TimeNs until,
                    const std::function<void()>& signalled);
  Status run_tasks(TimeNs now);

  Where where_;
  int drones_;
  const LiveObservation& live_;
  Children& children_;
  std::vector<Planned> planned_;
  std::map<std::string, std::string> lines_;  // of tasks
  std::deque<Task> tasks_;                    // at most two a fault
  std::set<std::string> killed_parts_;
  std::map<int, std::unique_ptr<CpuLoad>> cpu_loads_;
  std::multimap<std::uint64_t, std::vector<char>> memory_;  // by size
};

}  // namespace ledgerline::hil
