#pragma once
#include <functional>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline {

class Config;

/// How every program ends: 0 as it should, 1 it could not do its work, 2 it was asked in a way that makes no sense.
inline constexpr int exit_failed = 1;
inline constexpr int exit_usage = 2;

/// What --version prints of a program ("agent"; "" is `ledgerline` itself), without a line's end.
std::string version_line(const std::string& program);

/// Logs what went wrong and returns `exit_code`: `return fail(status.error());`
int fail(const Error& error, int exit_code = exit_failed);
/// The exit code of work that ended: what went wrong is logged; false is a failure that the program has reported
/// itself.
int exit_code(const Status& ended);
int exit_code(const Result<bool>& ended);

/// For a program that runs until it is asked to end, before it starts threads. A reader of its output may go: writing
/// fails from then on, where a tool is to end with its reader. Its log may stand still: no thread of the program waits
/// for it. Else a `tee` would end a link in the air.
void outlive_readers();

/// A line of results, which are read as they come, or by nobody any more: that is no error.
void print_line(const std::string& line);
/// The same of a line that the next one replaces: left out while the reader stalls, so no loop waits for it. A line of
/// more than 4,096 bytes may wait all the same.
void print_status(const std::string& line);

/// A program whose only argument is a TOML file: `argument` is "--config", or a name for a place on the line.
struct ConfigProgram {
  std::string name;   ///< without "ledgerline-"
  std::string about;  ///< above the options in help
  std::string notes;  ///< below them: examples, keys, exit codes
  std::string argument = "--config";
};

/// main() of such a program: command line, log, SIGINT, SIGTERM and SIGHUP (stop_signals.hpp), and the file; then
/// `run`, which returns the exit code. It outlives who reads its output (outlive_readers).
int run_with_config(int argc, char** argv, const ConfigProgram& program, const std::function<int(Config&)>& run);

}  // namespace ledgerline
