#pragma once
#include <optional>
#include <string>
#include <vector>

#include "tools/timing/figures.hpp"

namespace ledgerline::timing {

/// The folder of a run: link's, agent's and ground's traces and fly's record of CPU time, complete or still growing.
/// A program that was started again during the flight has a trace of each life; of those that begin while the traces
/// are being followed, nothing is read.
class Recording {
 public:
  explicit Recording(std::string directory);

  /// Reads what is new in the traces. An error when a file is damaged, or link's is not there; the other two may be
  /// missing (see missing()).
  Status read_new();
  /// Those that were not there, once all has been read.
  std::vector<std::string> missing() const;

  Walks& walks() { return walks_; }
  /// Link's turns so far; `forget` takes out those before.
  const std::vector<TraceRecord>& loop_turns() const { return loop_turns_; }
  void forget_turns_before(TimeNs t_ns);

  Result<UsageRecord> usage() const;

 private:
  struct File {
    Writer writer;
    std::uint32_t life;
    std::string name;
    std::optional<TraceReader> reader = {};
  };
  std::string directory_;
  std::vector<File> files_;
  Walks walks_;
  std::vector<TraceRecord> loop_turns_;
};

}  // namespace ledgerline::timing
