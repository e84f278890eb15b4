#pragma once
#include <functional>
#include <memory>
#include <string>

#include "common/base/result.hpp"
#include "common/program/command_line.hpp"
#include "common/rt/clock.hpp"
#include "tools/station/shell/station.hpp"

namespace ledgerline::station {

/// What every program of the station's command line takes.
struct Options {
  std::string url, token_file, config, session_file;
  web::TlsFiles tls{};
  bool json = false;
  bool signs_in = false;  ///< which makes the session's file
};
void add_options(CommandLine& line, Options& options);
/// For notes: the environment, and the exit codes.
extern const char* const shared_notes;

/// Which station, and the files that open it.
struct Target {
  StationAddress address;
  std::string token_file, session_file;  ///< no session file: nobody signs in
  bool session_expected = false;         ///< an option names its file, and it is not about to be made
  bool token_named = false;              ///< by an option, not by a config or by default
  web::TlsFiles tls{};
  std::string hint{};  ///< of a station that nobody has named: what names it
};
/// By the options, else a config's [service], else the environment, else this user's flight (flight_link). An error is
/// bad usage.
using Environment = std::function<std::string(const char* name)>;  ///< empty: not set
Result<Target> target_of(const Options& options, const Environment& environment);
Result<Target> target_of(const Options& options);  ///< by this process's environment

/// With the page's token, and the operator's session if there is one. A session that cannot be read is a warning, so
/// that it does not keep a drone in the air.
Result<std::unique_ptr<Station>> open(const Target& target);

/// The rest of a program: acts at the station that the options name; the exit code.
int run(const Options& options, const std::function<Status(Station& station, const Target& target)>& act);

/// Prints a table, on a terminal in the place of what was there.
void print_refreshed(const std::string& text);
/// Sleeps; less when a signal asks to end.
void rest(TimeNs duration_ns);
/// "14:05:09" of the ground's clock, by this computer's.
std::string time_of_day(double t_ms, double now_ms);

}  // namespace ledgerline::station
