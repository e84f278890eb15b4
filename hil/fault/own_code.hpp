#pragma once
#include <fstream>
#include <string>
#include <vector>

#include "common/process/children.hpp"
#include "hil/fault/checker/rule.hpp"
#include "hil/fault/script.hpp"

// Somebody's own code in a fault run (docs/faults.md).
namespace ledgerline::hil {

/// What is under test besides Ledgerline. Empty: nothing.
struct OwnCode {
  std::string controller;            ///< file: a plug-in in the place of ground's controller
  std::vector<std::string> program;  ///< command: a client of the SDK, or one that speaks to a drone's topics
};

/// The words of a command line, as a shell would take them: blanks part them, single and double quotes keep them
/// together, \ takes a character as it is; nothing is expanded. The error says which quote has no end.
Result<std::vector<std::string>> words_of_command(const std::string& line);

/// Where a program is that a command line names: as it is where it has a slash, else in PATH. The error says so.
Result<std::string> program_at(const std::string& name);

/// Why this script cannot be flown in simulated time: nobody is there who flies it.
Status check_sitl(const Script& script);

/// Whether this script can be flown with that code, and puts a controller into it. Errors name the script.
Status put_into(Script& script, const OwnCode& own);

/// Somebody's program in a flight: one child, named `program`, with what it prints in DIRECTORY/program.out and
/// program.log. One thread; `children` must outlive it and hand its lines over.
class OwnProgram {
 public:
  static inline const std::string name = "program";

  OwnProgram(Children& children, std::vector<std::string> command, std::string directory)
      : children_(children), command_(std::move(command)), directory_(std::move(directory)) {}

  bool has_command() const { return !command_.empty(); }
  /// `before`: words that start it somewhere else (a namespace); `environment`: "NAME=value".
  Status start(const std::vector<std::string>& before, const std::vector<std::string>& environment);
  void add_line(const std::string& line);
  bool started() const { return started_; }
  bool is_running() const { return children_.is_running(name); }
  /// Ends it where it still runs: then it has not ended by itself. With it, what it started in its process group.
  void end();
  /// Whether it ended by itself, with exit code 0; as a rule of the run.
  Verdict verdict(TimeNs at_ns) const;

 private:
  static constexpr std::uint64_t max_output = 10'000'000;  ///< bytes in its file; what comes behind is left out
  Children& children_;
  std::vector<std::string> command_;
  std::string directory_;
  std::ofstream output_;
  std::uint64_t written_ = 0;
  bool started_ = false, ended_here_ = false;
};

/// For a program that speaks to the drones' topics: DDS on loopback, where ground listens, unless the caller's
/// environment already sets all of it; and who flies.
std::vector<std::string> topics_environment(int drones);

}  // namespace ledgerline::hil
