#pragma once
#include <sys/types.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"

namespace ledgerline {

/// One thread since it began, as /proc reports it.
struct ThreadUsage {
  std::string program;  ///< "link"; a process that a program started: "fabric/peer"
  std::string name;     ///< of the thread
  pid_t process = 0, thread = 0;
  double user_s = 0, system_s = 0;               ///< in the kernel's ticks
  double cpu_s = 0;                              ///< both, to the nanosecond where the kernel has schedstat
  double waited_s = 0;                           ///< ready to run, but without a CPU; 0 without schedstat
  std::uint64_t voluntary = 0, involuntary = 0;  ///< context switches
  std::uint64_t minor_faults = 0, major_faults = 0;
  int policy = 0;  ///< SCHED_OTHER 0, SCHED_FIFO 1, SCHED_RR 2
  int priority = 0;
};

/// Since boot, of all CPUs or one.
struct HostUsage {
  double busy_s = 0, steal_s = 0;  ///< steal: ready to run while the host of this virtual machine ran others
};

/// From the texts of /proc/PID/task/TID/{stat,status,schedstat}, of which the last may be empty. None when `stat` is
/// not of the form that proc(5) describes. Program, process and thread are the caller's.
std::optional<ThreadUsage> parse_thread(const std::string& stat, const std::string& status,
                                        const std::string& schedstat, double ticks_per_s);
/// From the text of /proc/stat; `cpu`: "cpu" for all, "cpu1" for one. None when that line is not there.
std::optional<HostUsage> parse_host(const std::string& stat, const std::string& cpu, double ticks_per_s);

/// The threads of a process and of those that it started. Empty when it is gone.
std::vector<ThreadUsage> read_threads(const std::string& program, pid_t process);
HostUsage read_host(const std::string& cpu = "cpu");

/// A process and all that descend from it, as they are now.
std::vector<pid_t> process_tree(pid_t root);
/// Bytes that programs may still have without swapping; 0: the kernel does not say.
std::uint64_t available_memory();
/// Of a process and of those that it started that still run; 0 when it is gone. Memory is its proportional set (shared
/// pages count in parts); to be called seldom: the kernel walks all page tables for it.
double cpu_seconds_of(pid_t process);
double memory_mb_of(pid_t process);

}  // namespace ledgerline
