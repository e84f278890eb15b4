#pragma once
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "common/base/result.hpp"
#include "common/rt/trace.hpp"

namespace ledgerline {

/// What a program writes down of its run, where it is asked to: a trace while it goes on, a summary when it ends. One
/// thread.
class Recorder {
 public:
  /// Opens the trace; no file where the name is empty.
  Status open(const std::string& trace_file);
  void add(std::span<const TraceRecord> records);
  /// The rest of the trace, with a warning if records did not fit; then what `summary` makes, into `summary_file`, if
  /// that is not empty.
  Status end(const std::string& summary_file, const std::function<std::string()>& summary);

 private:
  std::string trace_file_;
  std::optional<TraceWriter> trace_;
};

}  // namespace ledgerline
