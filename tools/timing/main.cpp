#include <fmt/format.h>
#include <unistd.h>

#include <deque>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <thread>

#include "common/base/file.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/launcher/machine.hpp"
#include "tools/timing/metrics.hpp"
#include "tools/timing/self_test.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::timing;
using nlohmann::json;

constexpr int exit_limit = 1, exit_unreadable = 3;
constexpr TimeNs window_ns = 10 * ns_per_s;
constexpr TimeNs settled_after_ns = 4 * ns_per_s;  // a sample's trace is over, and its last record is in the file

struct Options {
  std::string directory;
  bool live = false, self_test = false, transports = false;
  int drones = 16, pairs = 5;
  double every_s = 2, seconds = 0;
  int cpu = -1, priority = 80;
  std::size_t threads = 12;
  std::vector<std::string> limits;
  std::string json, html, perfetto;
};

int fail(const std::string& what) {
  fmt::print(stderr, "timing: {}\n", what);
  return exit_unreadable;
}

json machine() {
  const launcher::Machine m = launcher::describe_machine();
  return {{"cpu", m.cpu}, {"cores", m.cores}, {"memory_gb", m.memory_gb}, {"system", m.system}};
}

/// All that was measured, with the CPU time between fly's snapshots, or until `newest` where fly has not ended.
Metrics metrics_of(TraceFolder& traces_folder, const std::vector<SampleTrace>& traces, const Snapshot& newest) {
  Metrics metrics = make_metrics(traces, traces_folder.loop_turns());
  metrics.damaged = traces_folder.traces().counters();
  if (const auto usage = traces_folder.usage()) {
    const bool ended = usage->end.t_ns > usage->begin.t_ns;
    metrics.load = load_between(usage->begin, ended ? usage->end : newest);
  } else {
    fmt::print(stderr, "timing: CPU time is not known: {}\n", usage.error().message);
  }
  return metrics;
}

int lay_open(const Options& options, const std::vector<Limit>& limits, const Snapshot& newest) {
  TraceFolder traces_folder(options.directory);
  if (auto status = traces_folder.read_new(); !status) return fail(status.error().message);
  for (const auto& file : traces_folder.missing())
    fmt::print(stderr, "timing: {} is missing: its stages are not measured\n", file);
  const std::vector<SampleTrace> traces = traces_folder.traces().pop();
  const Metrics metrics = metrics_of(traces_folder, traces, newest);
  std::vector<Verdict> verdicts;
  for (const Limit& limit : limits) verdicts.push_back(check(limit, metrics));
  std::cout << to_table(metrics, options.threads) << to_table(verdicts);

  json document = to_json(metrics, verdicts);
  document["asked"] = {{"directory", options.directory}, {"limits", options.limits}};
  document["machine"] = machine();
  Status written = done;
  if (!options.json.empty()) written = write_file(options.json, document.dump(2) + "\n");
  if (written && !options.html.empty()) written = write_file(options.html, to_page(document));
  if (written && !options.perfetto.empty()) {
    std::ofstream file(options.perfetto);
    const std::size_t left_out = write_perfetto(file, traces, traces_folder.loop_turns());
    file.close();
    if (!file) written = Error{"cannot write " + options.perfetto};
    if (left_out > 0)
      fmt::print(stderr, "timing: {} has the newest samples; {} are left out\n", options.perfetto, left_out);
  }
  std::cout.flush();
  if (!written) return fail(written.error().message);
  return document["ok"].get<bool>() ? EXIT_SUCCESS : exit_limit;
}

/// Shows the last ten seconds repeatedly: until the flight ends, the time is over, or Ctrl-C.
int follow(const Options& options, const std::vector<Limit>& limits) {
  TraceFolder traces_folder(options.directory);
  std::deque<SampleTrace> window;
  const auto usage = traces_folder.usage();
  if (!usage) return fail("no flight to follow: " + usage.error().message);
  Snapshot before = usage->begin;
  const TimeNs until_ns = options.seconds > 0 ? monotonic_ns() + from_seconds(options.seconds) : INT64_MAX;
  while (!stop_requested && monotonic_ns() < until_ns) {
    if (auto status = traces_folder.read_new(); !status) return fail(status.error().message);
    const Snapshot now = read_snapshot(usage->programs);
    if (now.threads.empty()) break;
    const TimeNs newest_ns = now.t_ns - settled_after_ns;
    for (const SampleTrace& trace : traces_folder.traces().pop(newest_ns)) window.push_back(trace);
    while (!window.empty() && window.front().at(Mark::sampled) < newest_ns - window_ns) window.pop_front();
    traces_folder.forget_turns_before(now.t_ns - window_ns);
    Metrics metrics = make_metrics(std::vector<SampleTrace>(window.begin(), window.end()), traces_folder.loop_turns());
    metrics.damaged = traces_folder.traces().counters();
    metrics.load = load_between(before, now);
    before = now;
    std::cout << (::isatty(STDOUT_FILENO) ? "\033[H\033[J" : "") << to_table(metrics, options.threads) << std::flush;
    for (TimeNs waited = 0; waited < from_seconds(options.every_s) && !stop_requested; waited += 50 * ns_per_ms)
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  std::cout << "\nThe whole flight so far:\n";
  return lay_open(options, limits, before);
}

int core_of(const Options& options) {
  return options.cpu >= 0 ? options.cpu : static_cast<int>(std::max(1U, std::thread::hardware_concurrency())) - 1;
}

int self_test(const Options& options) {
  SelfTestOptions asked;
  if (options.seconds > 0) asked.seconds = options.seconds;
  asked.priority = options.priority;
  asked.cpu = core_of(options);
  const SelfTest test = run_self_test(asked);
  std::cout << to_table(test) << std::flush;
  if (!options.json.empty()) {
    const auto metrics = [](const Lateness& l) {
      json one = to_json(tail_of(l.late));
      one["overruns"] = l.overruns;
      return one;
    };
    const json document{{"asked", {{"seconds", asked.seconds}, {"priority", asked.priority}, {"cpu", asked.cpu}}},
                        {"machine", machine()},
                        {"seconds", test.seconds},
                        {"fifo", test.real_time.scheduled},
                        {"memory_locked", test.real_time.locked},
                        {"notices", test.real_time.notices},
                        {"loop_ms", metrics(test.loop)},
                        {"cyclictest_ms", test.cyclictest ? metrics(*test.cyclictest) : json()},
                        {"why_no_cyclictest", test.why_no_cyclictest},
                        {"steal_s", test.steal_s},
                        {"good", test.good()}};
    if (auto written = write_file(options.json, document.dump(2) + "\n"); !written)
      return fail(written.error().message);
  }
  fmt::print("  {} enough for link: {}\n", test.good() ? "good" : "NOT good", criterion());
  return test.good() ? EXIT_SUCCESS : exit_limit;
}

int transports(const Options& options) {
  TransportsOptions asked;
  asked.drones = options.drones;
  asked.pairs = options.pairs;
  if (options.seconds > 0) asked.seconds = options.seconds;
  asked.priority = options.priority;
  asked.cpu = core_of(options);
  const auto runs = run_transports(asked);
  if (!runs) return fail(runs.error().message);
  std::cout << to_table(*runs) << std::flush;
  if (options.json.empty()) return EXIT_SUCCESS;
  json document = to_json(*runs);
  document["asked"] = {
      {"drones", asked.drones}, {"pairs", asked.pairs}, {"seconds", asked.seconds}, {"cpu", asked.cpu}};
  document["machine"] = machine();
  const Status written = write_file(options.json, document.dump(2) + "\n");
  return written ? EXIT_SUCCESS : fail(written.error().message);
}

constexpr const char* about =
    "Lays a flight's time open: every sample's way from stage to stage, how late link's loop was, and who used the "
    "CPU.";
constexpr const char* notes = R"(Examples:
  ledgerline timing build/runs/20261122-013000 --html timing.html --perfetto timing.json
  ledgerline timing /tmp/run --limit p99.9.late=200us --limit p99.setpoint_at_once=2.5ms --limit cpu.agent+link=15%
  ledgerline timing /tmp/run --limit overruns=0 --limit headroom=50%
  ledgerline timing /tmp/run --live
  ledgerline timing --self-test --seconds 60
  ledgerline timing --transports --drones 16 --pairs 5
Exit codes: 0 done, all limits kept; 1 a limit is not kept, or the self-test is not good enough for link;
2 bad usage, or a limit on something that does not exist; 3 nothing to read, or a file not written)";

void add_options(CommandLine& line, Options& o) {
  line.option("DIR", o.directory,
              "Directory of a run of ledgerline fly (its --out), or SCRIPT-SEED of fault run --real");
  line.flag("--live", o.live, "Follow a flight in progress: the last ten seconds, then all of it");
  line.option("--every", o.every_s, "Seconds between two tables of --live").within(0.2, 60.0).shows_default();
  line.flag("--self-test", o.self_test, "No flight: link's loop alone on this machine, beside cyclictest");
  line.flag("--transports", o.transports,
            "No flight: what link's way to its drones costs, UDP on loopback beside the shim's shared memory");
  line.option("--drones", o.drones, "Transports: how many").within(1, 16).shows_default();
  line.option("--pairs", o.pairs, "Transports: runs over each").within(1, 1000).shows_default();
  line.option(
          "--seconds", o.seconds,
          "How long to follow (default: to the end), to test (default: 10), or one run of --transports (default: 5)")
      .within(0.1, 86'400.0);
  line.option("--cpu", o.cpu, "Self-test, transports: core of the loop (default: the last)").within(0, 1023);
  line.option("--priority", o.priority, "Self-test, transports: SCHED_FIFO priority of the loop")
      .within(2, 98)
      .shows_default();
  line.option("--limit", o.limits, "What must hold, such as p99.apply=1ms; may be given often");
  line.option("--threads", o.threads, "How many threads the table shows").shows_default();
  line.option("--json", o.json, "Write the figures to this file, as one JSON object");
  line.option("--html", o.html, "Write a page that opens without a network");
  line.option("--perfetto", o.perfetto, "Write trace events that ui.perfetto.dev and chrome://tracing open");
}

}  // namespace

int ledgerline::command::timing(int argc, char** argv) {
  CommandLine line("ledgerline timing", about, notes);
  Options o;
  add_options(line, o);
  if (const auto end = line.parse(argc, argv)) return *end;
  if ((o.self_test ? 1 : 0) + (o.transports ? 1 : 0) + (o.directory.empty() ? 0 : 1) != 1) {
    fmt::print(stderr, "timing: name the directory of a run, or --self-test, or --transports: see --help\n");
    return exit_usage;
  }
  std::vector<Limit> limits;
  for (const std::string& text : o.limits) {
    auto limit = parse_limit(text);
    if (!limit) {
      fmt::print(stderr, "timing: {}\n", limit.error().message);
      return exit_usage;
    }
    limits.push_back(std::move(*limit));
  }
  catch_stop_signals();
  if (o.self_test) return self_test(o);
  if (o.transports) return transports(o);
  return o.live ? follow(o, limits) : lay_open(o, limits, {});
}
