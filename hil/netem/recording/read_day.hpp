#pragma once
#include <string>

#include "common/base/result.hpp"
#include "hil/netem/recording/day.hpp"

namespace ledgerline::hil {

/// A table (parse_day()), or a capture with one drone in it, of which the states' day is taken (day_of_states()).
Result<Day> read_day(const std::string& path);

/// Reads each file once, and gives that again whatever becomes of it; copies know what the others read. One thread.
ReadDay reading_days_once(ReadDay read = read_day);

/// What of a capture a table is made.
struct RecordingOptions {
  std::string drone{};   ///< its address; empty: the only one
  bool answers = false;  ///< of commands and their answers; otherwise of states
};
/// The table of a capture, with a line about it before: what `ledgerline hil day` prints.
Result<std::string> table_of_capture(const std::string& path, const RecordingOptions& asked);

}  // namespace ledgerline::hil
