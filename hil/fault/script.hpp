#pragma once
#include <cstdint>
#include <functional>
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
/// `real`: for a flight with the real processes (hil/fault/real/real.hpp).
Result<Script> parse_script(std::string_view toml, const std::string& file, bool real = false);
Result<Script> load_script(const std::string& path, bool real = false);
/// Asks for every key of a script; what is wrong is for config.finish() to say. For schemas, a describing Config.
Script read_script(Config& config, const std::string& file, bool real = false);
/// What parse_script() reads as the same again.
std::string text_of(const Script& script);

/// JSON Schema (draft 7) of a fault script, for editors and other programs: its keys as the reader of scripts asks for
/// them, its faults, moments and rules as their tables have them. A script that parse_script() takes is valid; one that
/// is valid may still be wrong in what no schema can say, such as a drone that does not fly.
std::string script_schema();

/// A course's waypoints as rows of a CSV file.
std::string course_rows(const ground::Task& task);

/// A script from the fault space: a flight of about 30 s with one to four faults, one in five with a death of link
/// behind which the drone is not seen, one in three by onboard odometry; only the invariants are checked. The same
/// number, the same script. `recording`: a file of delays that some of them have (hil/netem/distribution.hpp).
Script draw_script(std::uint64_t number, const std::string& recording = {});

/// The shortest script that still fails: faults left out, laps, drones and durations made less, as long as `fails` says
/// so. Calls it at most `max_tries` times. `script` itself must fail.
Script shrink(Script script, const std::function<bool(const Script&)>& fails, int max_tries = 200);

// Scripts as files: those that come with the program, those that a person names, and one to begin with.

/// Folder of the scenarios that come with a program of `prefix`: share/ledgerline/scenarios, where they are
/// installed, else hil/scenarios of the source tree that the program was built in. The error says where was looked.
Result<std::string> scenario_folder(const std::string& prefix);

/// All *.toml in it and below, sorted; the error says that there is none.
Result<std::vector<std::string>> scripts_in(const std::string& folder);

/// The files that a person means: each name is a file, a folder, or a scenario or group of scenarios that comes with
/// the program. Sorted, each once.
Result<std::vector<std::string>> scripts_named(const std::vector<std::string>& names, const std::string& prefix);

/// Name of a scenario, and group: the folder that it lies in, below the one that was looked into.
std::string name_of_script(const std::string& file);
std::string group_of(const std::string& file, const std::string& folder);

/// A script to begin with, for a file of this name: every part with a word on it, ready to fly; it holds.
std::string first_script(const std::string& name);

}  // namespace ledgerline::hil
