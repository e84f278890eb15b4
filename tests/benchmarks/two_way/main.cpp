// ledgerline bench two-way: the published bridge's design and Ledgerline side by side.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <fstream>

#include "common/rt/json.hpp"
#include "common/rt/log.hpp"
#include "ground/fly/machine.hpp"
#include "tests/benchmarks/two_way/lab.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::two_way;
namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* about =
    R"(Two-way exchange: side a (organisation 1) sends messages of 500 bytes, side b (organisation 2) answers each as it
sees it on the ledger, and a sees the answer. Latency is a's time from one to the other. msg/s counts both directions
together, as the published figures do: 70 msg/s are 35 messages and 35 answers a second.)";

constexpr const char* notes = R"(
Clients:
  published           Fabric's official Node.js client, one transaction a message, events; three orderers, 2 s / 10
  gateway             the same on one orderer, a block for each transaction ("our settings")
  direct              the same past the gateway: the peer's Endorser, one Broadcast stream to the orderer
  polling             as gateway, but asking again and again, with a cache of what was there the last time
  ledgerline          frames and the direct path, as agent and ground do, signed by libcrypto
  ledgerline-mbedtls  the same, signed by mbedTLS

Examples:
  ledgerline bench two-way --rates 30,70 --json two-way.json
  ledgerline bench two-way --rates 250 --clients gateway,ledgerline --alternations 1 --seconds 10
  ledgerline bench two-way --dir /var/tmp/two-way              ledgers on that disk

Exit codes: 0 measured (a client that collapses is a figure), 1 failed or interrupted, 2 wrong usage.)";

struct Options {
  std::vector<int> rates{30, 70, 110, 250, 1000};
  std::vector<std::string> clients;
  double seconds = 20, warm_up_s = 10, drain_s = 10;
  int alternations = 5;
  std::string ledger = "fabric", dir, json;
  Place place;
};

std::atomic<int> interrupts{0};

fs::path find_on_path(const std::string& program) {
  std::stringstream path(std::getenv("PATH") ? std::getenv("PATH") : "");
  for (std::string dir; std::getline(path, dir, ':');) {
    if (::access((fs::path(dir) / program).c_str(), X_OK) == 0) return fs::path(dir) / program;
  }
  return {};
}

/// build/PRESET/bin/ledgerline-bench: the rest of the tree is found from there.
void find_programs(Options& o) {
  std::error_code error;
  const char* other = std::getenv("LEDGERLINE_BIN");
  const fs::path own = fs::read_symlink("/proc/self/exe", error).parent_path();
  const fs::path build = own.parent_path().parent_path();
  o.place.programs = other ? fs::path(other) : own;
  o.place.script = build.parent_path() / "tests/benchmarks/two_way/node/client.cjs";
  if (o.place.fabric.empty()) o.place.fabric = build / "fabric";
  if (o.place.npm.empty()) o.place.npm = build / "npm";
  o.place.node = find_on_path("node");
  o.place.embedded = o.ledger == "embedded";
  if (o.dir.empty()) {
    const bool shared_memory = ::access("/dev/shm", W_OK) == 0;
    o.dir = fmt::format("{}/ledgerline-bench-{}", shared_memory ? "/dev/shm" : "/tmp", ::getpid());
  }
  o.place.dir = fs::absolute(o.dir, error);
}

Status check(const Options& o) {
  const bool baselines = std::any_of(o.clients.begin(), o.clients.end(),
                                     [](const auto& id) { return find_contender(id)->way != Way::ledgerline; });
  if (baselines && o.place.node.empty()) return Error{"node is not on PATH: the baselines need Node.js 20.9 or newer"};
  const fs::path client = o.place.npm / "node_modules/@hyperledger/fabric-gateway";
  if (baselines && !fs::exists(client)) {
    return Error{client.string() + " is missing: ./run-tests installs it, or npm ci in a copy of tests/system/node"};
  }
  if (baselines && !fs::exists(o.place.script)) return Error{o.place.script.string() + " is missing"};
  if (!o.place.embedded && !fs::exists(o.place.fabric / "peer")) {
    return Error{(o.place.fabric / "peer").string() + " is missing: scripts/fabric-tools builds it"};
  }
  if (fs::exists(o.place.dir) && !fs::is_empty(o.place.dir)) {
    return Error{o.place.dir.string() + " is not empty; give a directory that is, or does not exist"};
  }
  return done;
}

json to_json(const std::optional<Spread>& s) {
  if (!s) return nullptr;
  return {{"median", rounded(s->median, 1e4)},
          {"low", rounded(s->low, 1e4)},
          {"high", rounded(s->high, 1e4)},
          {"count", s->count}};
}

json to_json(const Run& r) {
  json times = json::array();
  for (const double ms : r.times_ms) times.push_back(rounded(ms));
  const auto cpu = r.cpu_ms_per_message();
  return {{"client", r.contender},
          {"rate", r.rate},
          {"alternation", r.alternation},
          {"position", r.position},
          {"p50_ms", rounded(r.quantile_ms(0.5))},
          {"p99_ms", rounded(r.quantile_ms(0.99))},
          {"cpu_ms_per_message", cpu ? json(rounded(*cpu, 1e4)) : json()},
          {"sent", r.sent},
          {"answered", r.answered},
          {"replaced", r.replaced},
          {"lost", r.lost()},
          {"cpu_s", rounded(r.cpu_s, 1e6)},
          {"answers", r.answers},
          {"transactions", r.transactions},
          {"failed", r.failed},
          {"dropped", r.dropped},
          {"saturated", r.saturated()},
          {"collapsed", r.collapsed()},
          {"timed_out", r.timed_out},
          {"why", r.why},
          {"latencies_ms", times}};
}

json to_json(const Summary& summary) {
  json figures = json::array(), ratios = json::array(), saturates = json::object();
  for (const auto& [rate, of_rate] : summary.figures) {
    for (const auto& [id, f] : of_rate) {
      figures.push_back({{"rate", rate},
                         {"client", id},
                         {"p50_ms", to_json(f.p50_ms)},
                         {"p99_ms", to_json(f.p99_ms)},
                         {"cpu_ms_per_message", to_json(f.cpu_ms_per_message)},
                         {"sent", f.sent},
                         {"answered", f.answered},
                         {"replaced", f.replaced},
                         {"lost", f.lost},
                         {"runs", f.runs},
                         {"saturated", f.saturated},
                         {"collapsed", f.collapsed}});
    }
  }
  for (const Ratios& r : summary.ratios) {
    ratios.push_back({{"rate", r.rate},
                      {"against", r.against},
                      {"p50", to_json(r.p50)},
                      {"p99", to_json(r.p99)},
                      {"cpu", to_json(r.cpu)},
                      {"cpu_mbedtls", to_json(r.cpu_mbedtls)}});
  }
  for (const auto& [id, rate] : summary.saturates_at) saturates[id] = rate ? json(*rate) : json();
  return {{"figures", figures}, {"ratios", ratios}, {"saturates_at", saturates}};
}

/// Networks and runs, one after the other.
class Measurement {
 public:
  explicit Measurement(const Options& options) : o_(options) {}

  Status run() {
    for (int alternation = 0; alternation < o_.alternations; ++alternation) {
      for (const int rate : o_.rates) {
        position_ = 0;
        std::vector<const Contender*> order;
        for (const std::string& id : o_.clients) order.push_back(find_contender(id));
        if (alternation % 2 == 1) std::reverse(order.begin(), order.end());
        for (auto from = order.begin(); from != order.end();) {
          const auto to = std::find_if(
              from, order.end(), [&](const auto* c) { return c->published_settings != (*from)->published_settings; });
          if (auto s = group({from, to}, rate, alternation); !s) return s;
          from = to;
        }
      }
    }
    return done;
  }

  const std::vector<Run>& runs() const { return runs_; }
  std::string storage() const {
    for (const json& one : networks_) {
      if (one.contains("storage") && one["storage"].is_string()) return one["storage"];
    }
    return "not known";
  }

  Status write_json() const {
    if (o_.json.empty()) return done;
    const fly::Machine machine = fly::describe_machine();
    const json head{{"asked",
                     {{"rates", o_.rates},
                      {"clients", o_.clients},
                      {"alternations", o_.alternations},
                      {"seconds", o_.seconds},
                      {"warm_up_s", o_.warm_up_s},
                      {"drain_s", o_.drain_s},
                      {"poll_ms", o_.place.poll_ms}}},
                    {"ledger", {{"kind", o_.ledger}, {"storage", storage()}, {"networks", networks_}}},
                    {"machine",
                     {{"cpu", machine.cpu},
                      {"system", machine.system},
                      {"cores", machine.cores},
                      {"memory_gb", rounded(machine.memory_gb)}}},
                    {"summary", to_json(summarize(runs_))}};
    std::string text = head.dump(1);
    text.resize(text.size() - 2);  // "\n}": the runs follow, one a line
    text += ",\n \"runs\": [";
    for (std::size_t i = 0; i < runs_.size(); ++i) text += (i > 0 ? ",\n  " : "\n  ") + to_json(runs_[i]).dump();
    std::ofstream file(o_.json);
    file << text << "\n ]\n}\n";
    file.close();
    if (!file) return Error{"cannot write " + o_.json};
    return done;
  }

 private:
  /// Contenders on one network; a new one after a collapse, so that nobody finds another's backlog.
  Status group(const std::vector<const Contender*>& contenders, int rate, int alternation) {
    std::optional<Network> network;
    const bool published = contenders.front()->published_settings;
    for (const Contender* contender : contenders) {
      if (!network) {
        network.emplace(o_.place, Network::settings(published), o_.place.dir / fmt::format("network{}", ++directories_),
                        interrupts);
        if (auto s = network->up(); !s) return s;
      }
      const Schedule schedule = make_schedule(rate, o_.warm_up_s, o_.seconds, o_.drain_s);
      auto run = exchange(o_.place, *network, *contender, schedule,
                          o_.place.dir / fmt::format("run{}", runs_.size() + 1), interrupts);
      if (!run) return run.error();
      run->rate = rate;
      run->alternation = alternation;
      run->position = position_++;
      tell(*run);
      runs_.push_back(std::move(*run));
      if (runs_.back().collapsed() || contender == contenders.back()) {
        if (auto s = end(*network, published); !s) return s;
        network.reset();
      }
      if (auto s = write_json(); !s) return s;
    }
    return done;
  }

  Status end(Network& network, bool published) {
    auto summary = network.down();
    if (!summary) return summary.error();
    const Network::Settings settings = Network::settings(published);
    (*summary)["orderers"] = settings.orderers;
    (*summary)["batch_count"] = settings.batch_count;
    (*summary)["batch_timeout_ms"] = settings.batch_timeout_ms;
    networks_.push_back(std::move(*summary));
    std::error_code error;
    fs::remove_all(o_.place.dir / fmt::format("network{}", directories_), error);
    return done;
  }

  void tell(const Run& r) const {
    const auto cpu = r.cpu_ms_per_message();
    spdlog::info(
        "{}/{} {:>4} msg/s  {:<26} p50 {:.1f} ms, p99 {:.1f} ms, CPU {:.2f} ms a message, {} of {} answered{}{}",
        r.alternation + 1, o_.alternations, r.rate, find_contender(r.contender)->title, r.quantile_ms(0.5),
        r.quantile_ms(0.99), cpu.value_or(0), r.answered, r.sent, r.collapsed() ? ", collapsed" : "",
        r.why.empty() ? "" : " (" + r.why + ")");
  }

  const Options& o_;
  int directories_ = 0, position_ = 0;
  std::vector<Run> runs_;
  json networks_ = json::array();
};

int measure(Options& options) {
  find_programs(options);
  if (auto s = check(options); !s) {
    spdlog::error("{}", s.error().what);
    return 1;
  }
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction action {};
    action.sa_handler = [](int) { ++interrupts; };
    ::sigaction(signal, &action, nullptr);
  }
  std::signal(SIGPIPE, SIG_IGN);
  Measurement measurement(options);
  Status status = measurement.run();
  if (!measurement.runs().empty()) {
    fmt::print("{}\n{}, ledgers on {}; {} alternations of {:g} s after {:g} s of warm-up; {} cores\n",
               to_table(summarize(measurement.runs())), options.ledger == "fabric" ? "Fabric" : "Embedded node",
               measurement.storage(), options.alternations, options.seconds, options.warm_up_s,
               fly::describe_machine().cores);
    if (auto written = measurement.write_json(); !written && status) status = written;
  }
  std::error_code error;
  if (!status) {
    spdlog::error("{} (what is left is in {})", status.error().what, options.place.dir.string());
    return 1;
  }
  fs::remove_all(options.place.dir, error);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Benchmarks against other designs", "ledgerline-bench"};
  app.require_subcommand(1);
  CLI::App* verb = app.add_subcommand("two-way", about);
  verb->footer(notes);
  Options o;
  for (const Contender& one : contenders()) o.clients.push_back(one.id);
  verb->add_option("--rates", o.rates, "msg/s of both directions together")
      ->delimiter(',')
      ->check(CLI::Range(2, 1100))
      ->capture_default_str();
  std::vector<std::string> ids = o.clients;
  verb->add_option("--clients", o.clients, "Who is measured, see below")
      ->delimiter(',')
      ->check(CLI::IsMember(ids))
      ->capture_default_str();
  verb->add_option("--seconds", o.seconds, "Measured time of a run")
      ->check(CLI::Range(0.5, 3600.0))
      ->capture_default_str();
  verb->add_option("--warm-up", o.warm_up_s, "Seconds before, left out")
      ->check(CLI::Range(0.0, 600.0))
      ->capture_default_str();
  verb->add_option("--drain", o.drain_s, "Seconds that answers are awaited after it, at most")
      ->check(CLI::Range(0.5, 600.0))
      ->capture_default_str();
  verb->add_option("--alternations", o.alternations, "How often all take turns; every other time in reverse order")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  verb->add_option("--poll-ms", o.place.poll_ms, "Polling: pause between an answer and the next question")
      ->check(CLI::Range(0.0, 10'000.0))
      ->capture_default_str();
  verb->add_option("--ledger", o.ledger, "fabric, or embedded for a quick look")
      ->check(CLI::IsMember({"fabric", "embedded"}))
      ->capture_default_str();
  verb->add_option("--dir", o.dir, "For ledgers and logs, empty or new [a new one under /dev/shm]");
  verb->add_option("--json", o.json, "Raw numbers and summary go here, after each run");
  verb->add_option("--fabric", o.place.fabric, "Fabric's own programs [build/fabric]");
  verb->add_option("--npm", o.place.npm, "Where node_modules is [build/npm]");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  init_log("bench");
  return measure(o);
}
