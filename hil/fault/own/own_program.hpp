#pragma once
#include <fstream>
#include <string>
#include <vector>

#include "common/process/children.hpp"
#include "hil/fault/checker/rule.hpp"

namespace ledgerline::hil {

/// Somebody's program in a flight: one child, named `program`, with what it prints in DIRECTORY/program.out and
/// program.log. One thread; `children` must outlive it and hand its lines over.
class OwnProgram {
 public:
  static inline const std::string name = "program";

  OwnProgram(Children& children, std::vector<std::string> command, std::string directory)
      : children_(children), command_(std::move(command)), directory_(std::move(directory)) {}

  bool wanted() const { return !command_.empty(); }
  /// `before`: words that start it somewhere else (a namespace); `environment`: "NAME=value".
  Status start(const std::vector<std::string>& before, const std::vector<std::string>& environment);
  void take_line(const std::string& line);
  bool started() const { return started_; }
  bool running() const { return children_.running(name); }
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
