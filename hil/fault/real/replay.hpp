#pragma once
#include <string>
#include <utility>
#include <vector>

#include "common/msg/contract.hpp"
#include "common/rt/trace.hpp"
#include "hil/fault/run/run.hpp"

namespace ledgerline::hil {

/// What a flight of the real processes left behind: their traces, on one clock, and how it ended.
struct Recording {
  std::vector<TraceRecord> link;    ///< of all its lives, in the order of time
  std::vector<TraceRecord> sim;     ///< where the drones were
  std::vector<TraceRecord> ground;  ///< its commands
  TimeNs begin_ns = 0, end_ns = 0;
  bool has_link = true;  ///< else an SDK client flew, and the truth alone is checked
  bool over = false;     ///< ended by itself
  bool ok = false;
  std::string why;
  std::vector<std::string> lost;     ///< what should be on the ledger and is not, in words
  std::vector<std::string> crashed;  ///< programs that ended though no fault did it, in words
  bool lost_is_known = true;         ///< who counts transitions has lived to the end
  struct Fault {
    std::string text;
    TimeNs begun_ns = 0;
    TimeNs ended_ns = 0;   ///< 0: it lasted to the end
    bool deafens = false;  ///< what a drone is sent may not get there
    std::string drone{};   ///< whose fault it is; empty: every drone's
  };
  std::vector<Fault> faults;
  std::vector<TimeNs> link_restarts;                 ///< the beginning of each life of link but its first
  std::vector<std::pair<TimeNs, TimeNs>> link_away;  ///< when link was dead or stood still
};

/// Checks a recording by the script's rules and the invariants, as run_script() checks a simulated run, with what
/// traces show: the truth thirty times a second, link's modes, the commands applied. Times are from the recording's
/// beginning. A plan's end is not in them: link must hold max_plan (the contract's limit, and how long a last setpoint
/// is flown) after the newest command, not after its own end.
RunResult check_recording(const Script& script, std::uint64_t seed, const Recording& recording);
inline constexpr TimeNs max_plan_ns = contract::max_plan_ns + 50 * ns_per_ms;

/// How much two runs of one script are alike: the modes and phases that each drone went through from take-off to
/// landing, and how far any place in the air of one is from the nearest of the other.
struct Agreement {
  bool same_transitions = true;
  double farthest_m = 0;
  std::string difference;  ///< the first one of the transitions
};
Agreement compare(const RunResult& a, const RunResult& b);
/// As a rule of the run, so that a difference breaks it wherever its verdicts are read.
Verdict verdict_on(const Agreement& agreement, double within_m, TimeNs at_ns);

}  // namespace ledgerline::hil
