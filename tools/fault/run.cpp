// ledgerline fault run: scripts in simulated time, or with the real processes.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <set>

#include "common/base/file.hpp"
#include "common/program/program.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/real/real_run.hpp"
#include "hil/fault/real/real_script.hpp"
#include "hil/fault/real/replay.hpp"
#include "hil/fault/run/run.hpp"
#include "hil/fault/scenarios.hpp"
#include "hil/fault/script.hpp"
#include "tools/fault/verbs.hpp"

namespace ledgerline::hil::verbs {
namespace {

constexpr double agree_within_m = 0.1;  // of the real processes and the simulated run of a script without faults
constexpr std::uint64_t max_flights = 200'000;  // all are held ready

struct RunOptions : FlightOptions {
  std::vector<std::string> scripts;
  bool real = false, shim = false, out_given = false;
  std::string ledger = "embedded";  // of --real
  std::string program;              // as it is given
  OwnCode own;
};

RealStack stack_of(const RunOptions& options) { return {options.ledger == "fabric", options.shim}; }

/// What is to be flown.
struct Wanted {
  std::vector<Flight> flights;
  std::map<std::string, std::string> sources;  ///< by the script's name
  std::vector<NotFlown> passed_over;           ///< in folders: they need another mode
};

Result<Wanted> read_all(const RunOptions& options) {
  // What is asked for by its own name is not passed over, as something in a folder is.
  std::set<std::string> files, named;
  for (const std::string& name : options.scripts) {
    const auto meant = scripts_named({name}, build_or_prefix());
    if (!meant) return meant.error();
    files.insert(meant->begin(), meant->end());
    std::error_code error;
    if (meant->size() == 1 && !std::filesystem::is_directory(name, error)) named.insert(meant->front());
  }
  std::vector<Script> scripts;
  Wanted wanted;
  std::map<std::string, std::string> file_of;  // by the script's name
  for (const std::string& file : files) {
    const auto text = read_file(file);
    if (!text) return text.error();
    auto script = parse_script(*text, file, options.real);
    if (!script) return script.error();
    if (const auto [same, fresh] = file_of.emplace(script->name, file); !fresh)
      return Error{fmt::format("{} and {}: two scripts of one name, {}: their results could not be distinguished",
                               same->second, file, script->name)};
    if (auto put = put_into(*script, options.own); !put) return put.error();
    if (const auto flown = check_sitl(*script); !flown && !options.real) {
      if (named.contains(file)) return flown.error();
      fmt::print(stderr, "not flown: {}\n", flown.error().message);
      wanted.passed_over.push_back({script->name, std::nullopt, flown.error().message, false});
      continue;
    }
    wanted.sources[script->name] = source_of(*text);
    scripts.push_back(std::move(*script));
  }
  if (scripts.empty()) return Error{"there is no script to fly"};
  std::optional<std::pair<std::uint64_t, std::uint64_t>> seeds;
  if (!options.seeds.empty()) {
    const auto parsed = parse_seeds(options.seeds);
    if (!parsed) return parsed.error();
    seeds = *parsed;
  }
  if (seeds && seeds->second - seeds->first >= max_flights / scripts.size())
    return Error{fmt::format("{} are too many seeds for {} scripts: {} flights are the most", options.seeds,
                             scripts.size(), max_flights)};
  wanted.flights = flights_of(scripts, seeds);
  return wanted;
}

/// What is said of a flight without faults, whose simulated run must agree; that is in the result's verdicts, too.
std::string agree(const Script& script, std::uint64_t seed, RunResult& result) {
  const auto simulated = run_script(script, seed);
  const Agreement agreement = simulated ? hil::compare(result, *simulated) : Agreement{false, 0, "no simulated run"};
  result.verdicts.push_back(verdict_on(agreement, agree_within_m, result.flown_ns));
  return fmt::format("{} its simulated run: {} transitions, places within {:.3f} m ({:.1f} m may be){}\n",
                     result.verdicts.back().held ? "agrees with" : "DIFFERS from",
                     agreement.same_transitions ? "the same" : "other", agreement.farthest_m, agree_within_m,
                     agreement.difference.empty() ? "" : "\n  " + agreement.difference);
}

/// The real processes, one flight after another.
void fly_really(const Wanted& wanted, const RunOptions& options, RunPrinter& printer) {
  const std::string programs = programs_directory();
  for (const Flight& flight : wanted.flights) {
    if (stop_requested) return;
    const auto& [script, seed] = flight;
    const std::string directory =
        fmt::format("{}/{}-{}", std::filesystem::absolute(options.out).string(), script.name, seed);
    auto result = run_really(script, seed, {programs, directory, stack_of(options), options.own, &stop_requested});
    if (stop_requested) return;  // it was ended before its time
    if (!result) {
      printer.print_failure(flight, result.error().message);
      continue;
    }
    const std::string agreed = script.faults.empty() && options.own.program.empty() ? agree(script, seed, *result) : "";
    printer.print_run(std::move(*result), wanted.sources.at(script.name), agreed);
  }
}

void fly_simulated(const Wanted& wanted, const RunOptions& options, RunPrinter& printer) {
  fly_all(
      wanted.flights.size(), options.jobs, [&](std::size_t i) { return wanted.flights[i]; },
      [&](std::size_t, const Flight& flight, Result<RunResult> result) {
        if (result) {
          printer.print_run(std::move(*result), wanted.sources.at(flight.script.name));
        } else {
          printer.print_failure(flight, result.error().message);
        }
        return !stop_requested;
      });
}

/// How the flights are flown, for their results.
std::string mode_of(const RunOptions& options) {
  if (!options.real) return "sitl";
  const RealStack stack = stack_of(options);
  return fmt::format("real{}{}", stack.shim ? "-shim" : "", stack.fabric ? "-fabric" : "");
}

int run_scripts(RunOptions& options) {
  if (!options.program.empty()) {
    auto words = words_of_command(options.program);
    if (!words) return usage_error("--program: " + words.error().message);
    options.own.program = std::move(*words);
  }
  if (options.real && (!options.out_given || options.jobs != 1))
    return usage_error("--real goes with --out FOLDER, and without --jobs: there is one flight at a time");
  const auto wanted = read_all(options);
  if (!wanted) return usage_error(wanted.error().message);
  for (const auto& [script, seed] : wanted->flights) {  // before any of them flies
    if (!options.real) break;
    if (const auto possible = check_real(script, stack_of(options), options.own); !possible)
      return usage_error(possible.error().message);
  }
  catch_stop_signals({SIGINT});
  RunPrinter printer(wanted->flights.size(), options.quiet, mode_of(options));
  for (const NotFlown& script : wanted->passed_over) printer.add_passed_over(script);
  if (options.real)
    fly_really(*wanted, options, printer);
  else
    fly_simulated(*wanted, options, printer);
  printer.print_total();
  return printer.write_files(options) ? printer.exit_code() : exit_broken;
}

}  // namespace

Act run(CommandLine& line) {
  const auto options = std::make_shared<RunOptions>();
  Verb verb = line.verb("run", "Flies scripts, or all *.toml of a folder");
  verb.option("SCRIPT", options->scripts, "files, folders, names of scenarios and their groups (`fault list`), or all")
      .required();
  verb.flag("--quiet", options->quiet, "say broken runs only");
  add_flight_options(verb, *options);
  const Option real =
      verb.flag("--real", options->real,
                "with the real processes, in real time, one flight after another (./fly --proxy); a script without "
                "faults must agree with its simulated run");
  verb.option("--ledger", options->ledger, "of --real").needs(real).one_of({"embedded", "fabric"}).shows_default();
  verb.flag("--shim", options->shim,
            "of --real: drones behind shared memory in place of UDP, which has faults at the SDK's own calls "
            "(docs/faults.md)")
      .needs(real);
  verb.option("--controller", options->own.controller,
              "a shared library that steers along the path in the place of ground's own controller (docs/faults.md)")
      .existing_file();
  verb.option("--program", options->program,
              "a command that flies scripts of kind manual (over the drones' topics) or sdk (over the SDK)")
      .needs(real);
  const Option out =
      verb.option("--out", options->out, "of --real: folder for what each flight leaves behind").needs(real);
  return {verb, [options, out] {
            options->out_given = out.is_given();
            return run_scripts(*options);
          }};
}

}  // namespace ledgerline::hil::verbs
