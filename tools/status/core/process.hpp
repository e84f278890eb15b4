#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/rt/clock.hpp"

/// What /proc says of a process, read. Pure.
namespace ledgerline::status {

/// A program of ours that runs on this host.
struct Program {
  std::string name;  ///< "ledgerline-agent"
  int pid = 0;
  std::string user{};     ///< its name, or its number where it has none
  std::string unit{};     ///< of systemd; empty: no unit started it
  std::string config{};   ///< absolute where it can be known; empty: it has none
  TimeNs age_ns = 0;      ///< since it was started
  bool replaced = false;  ///< its file is not the one that was started: another version begins with its next start
};

/// The command line's words: /proc/PID/cmdline, where a zero byte ends each.
std::vector<std::string> words_of(const std::string& cmdline);
/// What stands behind `--config`, or in `--config=...`; empty: neither is there.
std::string config_of(const std::vector<std::string>& words);
/// "ledgerline-agent.service" of /proc/PID/cgroup; empty: no unit's.
std::string unit_of(const std::string& cgroup);
/// When it was started, in s since boot, of /proc/PID/stat (proc(5), field 22); none: that is no such text.
std::optional<double> start_of(const std::string& stat, double ticks_per_s);
/// Of the text that /proc/PID/exe leads to: the program's file, and whether it is there no more.
struct Executable {
  std::string file;
  bool deleted = false;
};
Executable executable_of(const std::string& link);

}  // namespace ledgerline::status
