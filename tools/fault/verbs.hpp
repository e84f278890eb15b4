#pragma once
#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "common/program/command_line.hpp"
#include "common/rt/clock.hpp"
#include "hil/fault/report.hpp"
#include "hil/fault/run/run.hpp"

// The verbs of `ledgerline fault`. A new one: its function here, and in main.cpp's row of them.
namespace ledgerline::hil::verbs {

/// Of `run` and `random`.
struct FlightOptions {
  std::string seeds;  ///< empty: each script's own, or 1
  unsigned jobs = 1;
  std::string json, junit, html, csv, out;
  bool quiet = false;
};

void add_flight_options(Verb& verb, FlightOptions& options);

/// Says what is wrong, as it is: scripts' errors have lines of their own. Returns exit_usage.
int usage_error(const std::string& what);

/// Says what is wrong with a file that cannot be written.
bool write(const std::string& path, const std::string& text);

/// Prints how each run went and how long the rest will take; keeps what the files at the end are made of. One thread.
class RunPrinter {
 public:
  /// `mode`: how all are flown, as `fault compare` keeps modes apart.
  RunPrinter(std::size_t all, bool quiet, std::string mode);

  /// `source`: of which text of the script. `more`: printed behind it.
  void print_run(RunResult result, const std::string& source, const std::string& more = "");
  /// A flight that could not be flown: printed, and in the files.
  void print_failure(const Flight& flight, const std::string& why);
  /// A script that was passed over, for the files.
  void add_passed_over(NotFlown script) { not_flown_.push_back(std::move(script)); }
  /// A line on standard error, one in ten seconds at most, in long campaigns fewer.
  void print_progress(const std::string& text);
  /// Also says whether the campaign was interrupted.
  void print_total();
  /// Of what was flown; 0: every flight was flown, and held.
  int exit_code() const;
  /// The files that were asked for; false: one could not be written.
  bool write_files(const FlightOptions& options);

 private:
  static constexpr TimeNs min_progress_ns = 10 * ns_per_s;

  void clear() const;
  bool is_interrupted() const;
  void store(RunResult result);

  std::size_t all_, done_ = 0, broken_ = 0, errors_ = 0;
  double flown_s_ = 0;
  bool quiet_, terminal_;
  std::string mode_;
  TimeNs start_ns_ = monotonic_ns(), next_progress_ns_ = start_ns_ + min_progress_ns;
  std::vector<RunResult> kept_;  ///< in full; broken ones first
  std::vector<RunSummary> summaries_;
  std::vector<NotFlown> not_flown_;
};

/// A verb with its options, and what it does once the command line is read: the exit code is what it returns. The
/// options live as long as `act`.
struct Act {
  Verb verb;
  std::function<int()> act;
};

/// 1: a rule broke, a regression was found, or a file could not be written. 2 is exit_usage
/// (common/program/program.hpp).
inline constexpr int exit_broken = 1;
/// As a shell says of a program that SIGINT ended: the files have what was flown until then.
inline constexpr int exit_interrupted = 130;

Act run(CommandLine& line);
Act random(CommandLine& line);
Act list(CommandLine& line);
Act check(CommandLine& line);
Act make_new(CommandLine& line);
Act compare(CommandLine& line);
Act schema(CommandLine& line);

}  // namespace ledgerline::hil::verbs
