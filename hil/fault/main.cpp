#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/rt/clock.hpp"
#include "hil/fault/campaign.hpp"
#include "hil/fault/draw.hpp"
#include "hil/fault/real/real.hpp"
#include "hil/fault/real/replay.hpp"
#include "hil/fault/report.hpp"
#include "hil/fault/shrink.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::hil;
namespace fs = std::filesystem;

constexpr int exit_broken = 1;
constexpr double agree_within_m = 0.1;  // of the real processes and the virtual run of a script without faults
constexpr std::size_t max_kept = 200;   // results for the files; broken ones first

struct Options {
  std::string seeds;  // empty: each script's own, or 1
  unsigned jobs = 1;
  std::string json, junit, html, out;
  bool quiet = false;
  bool real = false;
  std::string ledger = "embedded";  // of --real
  std::string recording;            // of random
};

bool write(const std::string& path, const std::string& text) {
  const Status written = write_file(path, text);
  if (!written) spdlog::error("{}", written.error().what);
  return written.ok();
}

/// Says how each run went, and how long the rest will take.
class Teller {
 public:
  Teller(std::size_t all, bool quiet) : all_(all), quiet_(quiet), terminal_(::isatty(STDERR_FILENO) != 0) {}

  void told(const RunResult& result) {
    ++done_;
    flown_s_ += to_seconds(result.flown_ns);
    const double wall_s = to_seconds(monotonic_ns() - start_ns_);
    if (!result.held()) ++broken_;
    if (!result.held() || !quiet_) {
      clear();
      fmt::print("{} {} seed {}: {:.1f} s flown\n{}{}", result.held() ? "held  " : "BROKEN", result.script, result.seed,
                 to_seconds(result.flown_ns), broken_text(result), not_judged_text(result));
      std::fflush(stdout);
    }
    if (terminal_ && done_ < all_) {
      fmt::print(stderr, "\r{} of {}, {} broken, {:.0f} s left ", done_, all_, broken_,
                 wall_s / static_cast<double>(done_) * static_cast<double>(all_ - done_));
      std::fflush(stderr);
    }
  }
  void end() {
    clear();
    const double wall_s = to_seconds(monotonic_ns() - start_ns_);
    fmt::print("{} runs, {} broken; {:.0f} s flown in {:.1f} s: {:.0f} times real time\n", done_, broken_, flown_s_,
               wall_s, flown_s_ / wall_s);
  }
  std::size_t broken() const { return broken_; }

 private:
  void clear() const {
    if (terminal_) fmt::print(stderr, "\r{:60}\r", "");
  }
  std::size_t all_, done_ = 0, broken_ = 0;
  double flown_s_ = 0;
  bool quiet_, terminal_;
  TimeNs start_ns_ = monotonic_ns();
};

void keep(std::vector<RunResult>& kept, RunResult result) {
  if (kept.size() >= max_kept) {
    const auto held = std::find_if(kept.begin(), kept.end(), [](const RunResult& r) { return r.held(); });
    if (result.held() || held == kept.end()) return;
    kept.erase(held);
  }
  kept.push_back(std::move(result));
}

int files_and_code(const Options& options, std::vector<RunResult>& kept, std::size_t broken, bool failed) {
  std::sort(kept.begin(), kept.end(), [](const RunResult& a, const RunResult& b) {
    return std::tie(a.script, a.seed) < std::tie(b.script, b.seed);
  });
  bool written = true;
  if (!options.json.empty()) written = write(options.json, json_text(kept)) && written;
  if (!options.junit.empty()) written = write(options.junit, junit_text(kept)) && written;
  if (!options.html.empty()) written = write(options.html, html_text(kept)) && written;
  return failed || broken > 0 || !written ? exit_broken : 0;
}

/// The real processes, one flight after another; where nothing goes wrong the virtual run of the same script must
/// agree.
int run_all_really(const std::vector<Flight>& flights, const Options& options) {
  const char* elsewhere = std::getenv("LEDGERLINE_BIN");  // as for ledgerline-fly
  std::error_code error;
  const fs::path own = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const auto& [script, seed] : flights) {  // before any of them flies
    if (const auto possible = check_real(script, {options.ledger == "fabric"}); !possible) {
      fmt::print(stderr, "{}\n", possible.error().what);
      return exit_usage;
    }
  }
  Teller teller(flights.size(), options.quiet);
  std::vector<RunResult> kept;
  bool failed = false;
  for (const auto& [script, seed] : flights) {
    const std::string directory = fmt::format("{}/{}-{}", fs::absolute(options.out).string(), script.name, seed);
    auto result =
        run_really(script, seed, {elsewhere ? elsewhere : own.string(), directory, {options.ledger == "fabric"}});
    if (!result) {
      spdlog::error("{}: {}", script.name, result.error().what);
      failed = true;
      continue;
    }
    std::string agreed;
    if (script.faults.empty()) {
      const auto virtually = run_script(script, seed);
      const Agreement agreement = virtually ? compare(*result, *virtually) : Agreement{false, 0, "no virtual run"};
      result->verdicts.push_back(verdict_on(agreement, agree_within_m, result->flown_ns));
      agreed = fmt::format("{} its virtual run: {} transitions, places within {:.3f} m ({:.1f} m may be){}\n",
                           result->verdicts.back().held ? "agrees with" : "DIFFERS from",
                           agreement.same_transitions ? "the same" : "other", agreement.farthest_m, agree_within_m,
                           agreement.difference.empty() ? "" : "\n  " + agreement.difference);
    }
    teller.told(*result);
    fmt::print("{}", agreed);
    keep(kept, std::move(*result));
  }
  teller.end();
  return files_and_code(options, kept, teller.broken(), failed);
}

int run(const std::vector<std::string>& paths, const Options& options) {
  std::vector<std::string> files;
  for (const std::string& path : paths) {
    if (!fs::is_directory(path)) {
      files.push_back(path);
      continue;
    }
    for (const auto& entry : fs::recursive_directory_iterator(path)) {
      if (entry.path().extension() == ".toml") files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  std::vector<Script> scripts;
  for (const std::string& file : files) {
    auto script = load_script(file, options.real);
    if (!script) {
      fmt::print(stderr, "{}\n", script.error().what);
      return exit_usage;
    }
    scripts.push_back(std::move(*script));
  }
  if (scripts.empty()) {
    fmt::print(stderr, "there is no *.toml in {}\n", fmt::join(paths, ", "));
    return exit_usage;
  }
  std::optional<std::pair<std::uint64_t, std::uint64_t>> seeds;
  if (!options.seeds.empty()) {
    const auto parsed = parse_seeds(options.seeds);
    if (!parsed) {
      fmt::print(stderr, "{}\n", parsed.error().what);
      return exit_usage;
    }
    seeds = *parsed;
  }
  constexpr std::uint64_t max_flights = 200'000;  // all are held ready
  if (seeds && seeds->second - seeds->first >= max_flights / scripts.size()) {
    fmt::print(stderr, "{} are too many seeds for {} scripts: {} flights are the most\n", options.seeds, scripts.size(),
               max_flights);
    return exit_usage;
  }
  const std::vector<Flight> flights = flights_of(scripts, seeds);
  if (options.real) return run_all_really(flights, options);
  Teller teller(flights.size(), options.quiet);
  std::vector<RunResult> kept;
  bool failed = false;
  fly_all(
      flights.size(), options.jobs, [&](std::size_t i) { return flights[i]; },
      [&](std::size_t, const Flight& flight, Result<RunResult> result) {
        if (!result) {
          spdlog::error("{}: {}", flight.script.name, result.error().what);
          failed = true;
          return true;
        }
        teller.told(*result);
        keep(kept, std::move(*result));
        return true;
      });
  teller.end();
  return files_and_code(options, kept, teller.broken(), failed);
}

int random(const Options& options, bool shrinks) {
  const auto seeds = parse_seeds(options.seeds.empty() ? "1" : options.seeds);
  if (!seeds) {
    fmt::print(stderr, "{}\n", seeds.error().what);
    return exit_usage;
  }
  Teller teller(seeds->second - seeds->first + 1, true);
  std::vector<RunResult> kept;
  std::vector<Flight> broken;
  bool failed = false;
  fly_all(
      seeds->second - seeds->first + 1, options.jobs,
      [&](std::size_t i) {
        const std::uint64_t number = seeds->first + i;
        return Flight{draw_script(number, options.recording), number};
      },
      [&](std::size_t, const Flight& flight, Result<RunResult> result) {
        if (!result) {
          spdlog::error("{}: {}", flight.script.name, result.error().what);
          failed = true;
          return true;
        }
        teller.told(*result);
        if (!result->held()) broken.push_back(flight);
        keep(kept, std::move(*result));
        return true;
      });
  teller.end();
  for (const Flight& flight : broken) {
    Script script = flight.script;
    if (shrinks) {
      script = shrink(script, [&](const Script& shorter) {
        const auto again = run_script(shorter, flight.seed);
        return again && !again->held();
      });
    }
    script.seed = flight.seed;
    const auto result = run_script(script, flight.seed);
    fmt::print("\n# {}, seed {}\n{}{}", script.name, flight.seed, text_of(script), result ? broken_text(*result) : "");
    if (!options.out.empty()) {
      std::error_code error;
      fs::create_directories(options.out, error);
      failed = !write(fmt::format("{}/{}.toml", options.out, script.name), text_of(script)) || failed;
    }
  }
  return files_and_code(options, kept, broken.size(), failed);
}

std::string about() {
  return "Flies fault scripts in virtual time and says whether what must hold held.\n"
         "A script is a TOML file: a flight, its faults, and rules (docs/faults.md). Rules:\n" +
         rule_help();
}

constexpr const char* notes = R"(Examples:
  ledgerline fault run hil/scenarios                       the whole library
  ledgerline fault run my.toml --seeds 1..1000 --jobs 2 --html runs.html
  ledgerline fault random --seeds 1..10000 --jobs 2 --out broken

Exit codes: 0 all held; 1 a rule broke, or a file could not be written; 2 bad usage or a bad script.)";

void add_common_options(Verb verb, Options& options) {
  verb.option("--seed,--seeds", options.seeds, "N or FIRST..LAST; left out: the script's own, or 1");
  verb.option("--jobs", options.jobs, "flights at once").within(1, 64).shows_default();
  verb.option("--json", options.json, "everything as one object (of at most 200 runs, broken ones first)");
  verb.option("--junit", options.junit, "JUnit XML of the same runs");
  verb.option("--html", options.html, "a page with the timelines of the same runs");
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line("fault", about(), notes);
  Options options;
  std::vector<std::string> paths;
  Verb runs = line.verb("run", "Flies scripts, or all *.toml of a folder");
  runs.option("SCRIPT", paths, "files or folders").required().existing_path();
  runs.flag("--quiet", options.quiet, "say broken runs only");
  add_common_options(runs, options);
  const Option real =
      runs.flag("--real", options.real,
                "with the real processes, in real time, one flight after another (./fly --proxy); a script without "
                "faults must agree with its virtual run");
  runs.option("--ledger", options.ledger, "of --real").needs(real).one_of({"embedded", "fabric"}).shows_default();
  const Option out =
      runs.option("--out", options.out, "of --real: folder for what each flight leaves behind").needs(real);
  Verb randoms = line.verb("random", "Flies scripts drawn at random, number FIRST to LAST; shrinks what breaks");
  add_common_options(randoms, options);
  randoms.option("--recording", options.recording, "a file of delays, a number of seconds a line, for some of them")
      .existing_file();
  randoms.option("--out", options.out, "folder for the shortest scripts that break");
  bool shrinks = true;
  randoms.flag("!--no-shrink", shrinks, "leave broken scripts as they were drawn");
  if (const auto end = line.parse(argc, argv)) return *end;
  if (options.real && (!out.given() || options.jobs != 1)) {
    fmt::print(stderr, "--real goes with --out FOLDER, and without --jobs: there is one flight at a time\n");
    return exit_usage;
  }
  return runs.given() ? run(paths, options) : random(options, shrinks);
}
