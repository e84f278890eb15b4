#include "tools/fault/verbs.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <tuple>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/program/program.hpp"

namespace ledgerline::hil::verbs {
namespace {

constexpr std::size_t max_kept = 200;  // results in full for the files

void sort_by_script(auto& runs) {
  std::sort(runs.begin(), runs.end(),
            [](const auto& a, const auto& b) { return std::tie(a.script, a.seed) < std::tie(b.script, b.seed); });
}

}  // namespace

void add_flight_options(Verb& verb, FlightOptions& options) {
  verb.option("--seed,--seeds", options.seeds, "N or FIRST..LAST; left out: the script's own, or 1");
  verb.option("--jobs", options.jobs, "flights at once").within(1, 64).shows_default();
  verb.option("--json", options.json,
              "one object: figures of every run, for `fault compare`; the rest of at most 200, broken ones first");
  verb.option("--junit", options.junit, "JUnit XML: a testcase for each run");
  verb.option("--html", options.html, "a page with the timelines of the 200");
  verb.option("--csv", options.csv, "a line for each run: what broke, and its figures");
}

int usage_error(const std::string& what) {
  fmt::print(stderr, "{}\n", what);
  return exit_usage;
}

bool write(const std::string& path, const std::string& text) {
  const Status written = write_file(path, text);
  if (!written) spdlog::error("{}", written.error().message);
  return written.ok();
}

RunPrinter::RunPrinter(std::size_t all, bool quiet, std::string mode)
    : all_(all), quiet_(quiet), terminal_(::isatty(STDERR_FILENO) != 0), mode_(std::move(mode)) {}

void RunPrinter::print_run(RunResult result, const std::string& source, const std::string& more) {
  ++done_;
  flown_s_ += to_seconds(result.flown_ns);
  const double wall_s = to_seconds(monotonic_ns() - start_ns_);
  if (!result.all_held()) ++broken_;
  if (!result.all_held() || !quiet_) {
    clear();
    fmt::print("{} {} seed {}: {:.1f} s flown\n{}{}", result.all_held() ? "held  " : "BROKEN", result.script,
               result.seed, to_seconds(result.flown_ns), broken_text(result), not_checked_text(result));
  }
  fmt::print("{}", more);
  std::fflush(stdout);
  if (terminal_ && done_ < all_) {
    fmt::print(stderr, "\r{} of {}, {} broken, {:.0f} s left ", done_, all_, broken_,
               wall_s / static_cast<double>(done_) * static_cast<double>(all_ - done_));
    std::fflush(stderr);
  } else if (quiet_ && done_ < all_) {
    print_progress(fmt::format("{} of {}, {} broken", done_, all_, broken_));
  }
  summaries_.push_back(summary_of(result, source));
  summaries_.back().mode = mode_;
  store(std::move(result));
}

void RunPrinter::print_failure(const Flight& flight, const std::string& why) {
  clear();
  spdlog::error("{}: {}", flight.script.name, why);
  not_flown_.push_back({flight.script.name, flight.seed, why});
  ++errors_;
}

void RunPrinter::print_progress(const std::string& text) {
  constexpr TimeNs max_share = 50;  // a line each fiftieth of the time so far: some 300 in a day
  const TimeNs now = monotonic_ns();
  if (now < next_progress_ns_) return;
  next_progress_ns_ = now + std::max(min_progress_ns, (now - start_ns_) / max_share);
  clear();
  fmt::print(stderr, "{}\n", text);
}

void RunPrinter::print_total() {
  clear();
  if (is_interrupted()) {
    const std::string why = fmt::format("interrupted: {} of {} flown", done_, counted(all_, "run"));
    fmt::print("{}\n", why);
    not_flown_.push_back({.script = "the rest", .why = why, .interrupted = true});
  }
  const double wall_s = to_seconds(monotonic_ns() - start_ns_);
  fmt::print("{}, {} broken; {:.0f} s flown in {:.1f} s: {:.0f} times real time\n{}", counted(done_, "run"), broken_,
             flown_s_, wall_s, flown_s_ / wall_s, by_rule_text(summaries_));
}

int RunPrinter::exit_code() const {
  if (is_interrupted()) return exit_interrupted;
  return broken_ == 0 && errors_ == 0 ? 0 : exit_broken;
}

bool RunPrinter::write_files(const FlightOptions& options) {
  sort_by_script(kept_);
  sort_by_script(summaries_);
  sort_by_script(not_flown_);
  bool written = true;
  if (!options.json.empty()) written = write(options.json, json_text(kept_, summaries_, not_flown_)) && written;
  if (!options.junit.empty()) written = write(options.junit, junit_text(kept_, summaries_, not_flown_)) && written;
  if (!options.html.empty()) written = write(options.html, html_text(kept_, summaries_, not_flown_)) && written;
  if (!options.csv.empty()) written = write(options.csv, csv_text(summaries_)) && written;
  return written;
}

bool RunPrinter::is_interrupted() const { return stop_requested && done_ + errors_ < all_; }

void RunPrinter::clear() const {
  if (terminal_) fmt::print(stderr, "\r{:60}\r", "");
}

void RunPrinter::store(RunResult result) {
  if (kept_.size() >= max_kept) {
    const auto held = std::find_if(kept_.begin(), kept_.end(), [](const RunResult& r) { return r.all_held(); });
    if (result.all_held() || held == kept_.end()) return;
    kept_.erase(held);
  }
  kept_.push_back(std::move(result));
}

}  // namespace ledgerline::hil::verbs
