// ledgerline fault random: scripts drawn at random; what breaks is shrunk.
#include <fmt/format.h>

#include <csignal>
#include <memory>
#include <utility>

#include "common/program/program.hpp"
#include "hil/fault/random_script.hpp"
#include "hil/fault/run/run.hpp"
#include "hil/fault/shrink.hpp"
#include "tools/fault/verbs.hpp"

namespace ledgerline::hil::verbs {
namespace {

struct RandomOptions : FlightOptions {
  std::string recording;
  bool shrinks = true;
};

/// As its text says it, which rounds: what is printed of a broken flight has to break the same when it is flown.
Script as_written(const Script& script) {
  auto read = parse_script(text_of(script), script.name + ".toml");
  return read ? std::move(*read) : script;
}

/// A broken flight's shortest script, said and written; false: it could not be. An interrupt ends the shrinking.
bool tell_shortest(const Flight& flight, const RandomOptions& options, RunPrinter& printer) {
  Script script = flight.script;
  if (options.shrinks) {
    script = shrink(script, [&](const Script& shorter) {
      printer.print_progress("shrinking " + script.name);
      if (stop_requested) return false;
      const auto again = run_script(as_written(shorter), flight.seed);
      return again && !again->all_held();
    });
  }
  script.seed = flight.seed;
  const auto result = run_script(as_written(script), flight.seed);
  fmt::print("\n# {}, seed {}\n{}{}", script.name, flight.seed, text_of(script), result ? broken_text(*result) : "");
  return options.out.empty() || write(fmt::format("{}/{}.toml", options.out, script.name), text_of(script));
}

int fly_random(const RandomOptions& options) {
  const auto seeds = parse_seeds(options.seeds.empty() ? "1" : options.seeds);
  if (!seeds) return usage_error(seeds.error().message);
  const std::size_t count = seeds->second - seeds->first + 1;
  catch_stop_signals({SIGINT});
  RunPrinter printer(count, true, "sitl");
  std::vector<Flight> broken;
  bool fine = true;
  fly_all(
      count, options.jobs,
      [&](std::size_t i) {
        const std::uint64_t number = seeds->first + i;
        return Flight{as_written(draw_script(number, options.recording)), number};
      },
      [&](std::size_t, const Flight& flight, Result<RunResult> result) {
        if (!result) {
          printer.print_failure(flight, result.error().message);
          return !stop_requested;
        }
        if (!result->all_held()) broken.push_back(flight);
        printer.print_run(std::move(*result), source_of(text_of(flight.script)));
        return !stop_requested;
      });
  printer.print_total();
  for (const Flight& flight : broken) fine = tell_shortest(flight, options, printer) && fine;
  return printer.write_files(options) && fine ? printer.exit_code() : exit_broken;
}

}  // namespace

Act random(CommandLine& line) {
  const auto options = std::make_shared<RandomOptions>();
  Verb verb = line.verb("random", "Flies scripts drawn at random, number FIRST to LAST; shrinks what breaks");
  add_flight_options(verb, *options);
  verb.option("--recording", options->recording, "a file of delays, a number of seconds a line, for some of them")
      .existing_file();
  verb.option("--out", options->out, "folder for the shortest scripts that break");
  verb.flag("!--no-shrink", options->shrinks, "leave broken scripts as they were drawn");
  return {verb, [options] { return fly_random(*options); }};
}

}  // namespace ledgerline::hil::verbs
