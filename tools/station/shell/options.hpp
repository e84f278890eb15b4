#pragma once
#include <functional>
#include <memory>
#include <string>

#include "common/program/command_line.hpp"
#include "tools/station/core/place.hpp"
#include "tools/station/shell/station.hpp"

namespace ledgerline::station {

/// What every program of the station's command line takes.
struct Options {
  std::string url, token_file, config, session_file;
  web::TlsFiles tls{};
  bool json = false;
};
void add_options(CommandLine& line, Options& options);
/// For notes: the environment, and the exit codes.
extern const char* const shared_notes;

/// Which station, and the files that open it.
struct Target {
  Place place;
  std::string token_file, session_file;  ///< no session file: nobody signs in
  bool session_named = false;            ///< by an option, not by default
  web::TlsFiles tls{};
};
/// By the options, else a config's [service], else the environment. An error is bad usage.
using Environment = std::function<std::string(const char* name)>;  ///< empty: not set
Result<Target> target_of(const Options& options, const Environment& environment);
Result<Target> target_of(const Options& options);  ///< by this process's environment

/// With the page's token, and the operator's session if there is one. A session that cannot be read is a warning, so
/// that it does not keep a drone in the air.
Result<std::unique_ptr<Station>> open(const Target& target);

/// The rest of a program: acts at the station that the options name; the exit code.
int run(const Options& options, const std::function<Status(Station& station, const Target& target)>& act);

}  // namespace ledgerline::station
