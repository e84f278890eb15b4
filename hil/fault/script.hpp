#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "hil/fault/checker/checker.hpp"
#include "hil/fault/kinds/fault.hpp"
#include "hil/fault/pilot.hpp"

namespace ledgerline {
class Config;
}

namespace ledgerline::hil {

/// Who flies: ground along a path; a pilot's messages, over a drone's topics; a client of the drone's own SDK, without
/// link, agent and ledger.
enum class FlightKind : std::uint8_t { path, manual, sdk };
std::string_view name_of(FlightKind kind);

/// One flight, what goes wrong in it, and what must hold: a TOML file (docs/faults.md). Everything is checked when it
/// is read; what a script does not say has the default.
struct Script {
  std::string name;   ///< of the file, without folder and ending
  std::string title;  ///< one sentence
  FlightKind kind = FlightKind::path;
  WorldConfig flight;
  std::vector<PilotRow> pilot;        ///< of a manual flight in simulated time
  std::optional<std::uint64_t> seed;  ///< it is flown with, unless another is asked for
  TimeNs limit_ns = 120 * ns_per_s;   ///< longer a run never takes: not over by then is broken
  std::vector<Fault> faults;
  std::vector<Rule> must;  ///< a height always: flight height and 0.6 m where the script says none
};

/// An error is all that is wrong, each as "FILE:LINE: key: what is wrong, what is allowed".
/// `real`: for a flight with the real processes (hil/fault/real/real_run.hpp).
Result<Script> parse_script(std::string_view toml, const std::string& file, bool real = false);
Result<Script> load_script(const std::string& path, bool real = false);
/// Asks for every key of a script; what is wrong is for config.finish() to say. For schemas, a describing Config.
Script read_script(Config& config, const std::string& file, bool real = false);
/// What parse_script() reads as the same again.
std::string text_of(const Script& script);

/// A course's waypoints as rows of a CSV file.
std::string course_rows(const ground::Task& task);

}  // namespace ledgerline::hil
