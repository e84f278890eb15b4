#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/core/settings.hpp"

/// What of link outlasts it, in files.
namespace ledgerline::link {

/// The file of the local stops, so that they outlast link: one drone's name a line, between a first line that says what
/// it is and a last one with a checksum. Not for the real-time loop: it waits for a disk. One thread.
class LocalStopsFile {
 public:
  /// `path`: empty: nobody remembers.
  LocalStopsFile(std::string path, std::vector<DroneSettings> drones);

  /// None where there is no file. An error: it cannot be read or is not whole. Then nobody knows which, and all are.
  Result<DroneSet> read();
  /// With mode 0600; no effect where the file has them. Names that this link does not fly stay in it.
  Status store(const DroneSet& stopped);

 private:
  std::string text_of(const DroneSet& stopped) const;

  std::string path_;
  std::vector<DroneSettings> drones_;
  std::vector<std::string> others_;  ///< names in the file that are none of `drones`
  std::string kept_;                 ///< as the file is, or is not there; see read()
};

/// Writes this start into `file` and says how many starts it holds within starts_within_ns, this one counted: at most
/// 64. CLOCK_MONOTONIC, so what was written before the computer was switched on last counts nothing. A file that is
/// missing, torn or somebody else's text counts as none; the error is that it cannot be written, and then nobody
/// remembers this start. Before the real-time loop: it waits for a disk.
Result<int> record_start(const std::string& file, TimeNs now);

}  // namespace ledgerline::link
