// ledgerline bench: the published bridge's design beside Ledgerline.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>

#include "common/base/log.hpp"
#include "common/process/children.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/bench/measurement.hpp"
#include "tools/command/verbs.hpp"
#include "tools/launcher/machine.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::bench;
namespace fs = std::filesystem;

constexpr const char* about =
    R"(Two-way exchange: side a (organisation 1) sends messages of 500 bytes, side b (organisation 2) answers each as it
sees it on the ledger, and a sees the answer. Latency is a's time from one to the other. msg/s counts both directions
together, as the published figures do: 70 msg/s are 35 messages and 35 answers a second.)";

constexpr const char* notes = R"(
Clients:
  published             Fabric's official Node.js client, one transaction a message, events; three orderers, 2 s / 10
  ledgerline-published  Ledgerline on the published settings; only when it is asked for
  gateway               as published, on one orderer, a block for each transaction ("our settings")
  direct                the same past the gateway: the peer's Endorser, one Broadcast stream to the orderer
  polling               as gateway, but asking repeatedly, with a cache of what was there the last time
  ledgerline            frames and the direct path, signed by libcrypto; reads from its peer alone, as the others
  ledgerline-mbedtls    the same, signed by mbedTLS
  ledgerline-validated  as ledgerline, and each side validates every block and transaction
  ledgerline-ordered    as ledgerline-validated, and takes an orderer's blocks where they are first
  endorser              as ledgerline-validated; each organisation's own endorser endorses in its peer's place (Fabric alone;
                        when it is asked for)
  endorser-ordered      both of these
  endorser-within-ordered  as endorser-ordered, with each side's endorser within its client: its CPU time is the client's

Examples:
  ledgerline bench two-way --rates 30,70 --json two-way.json
  ledgerline bench two-way --rates 250 --clients gateway,ledgerline --alternations 1 --seconds 10
  ledgerline bench two-way --rates 70 --network=--background --network=org3      what a setting of the network brings
  ledgerline bench two-way --dir /var/tmp/two-way              ledgers on that disk

Exit codes: 0 measured (a client that collapses is a figure), 1 failed or interrupted, 2 wrong usage.)";

/// Of the tree that this is built in.
void find_programs(Options& o) {
  std::error_code error;
  const fs::path build = build_or_prefix().parent_path();
  o.paths.programs = programs_directory();
  o.paths.script = build.parent_path() / "tools/bench/node/client.cjs";
  if (o.paths.fabric.empty()) o.paths.fabric = build / "fabric";
  if (o.paths.npm.empty()) o.paths.npm = build / "npm";
  o.paths.node = find_program("node");
  o.paths.embedded = o.ledger == "embedded";
  if (o.dir.empty()) {
    const bool shared_memory = ::access("/dev/shm", W_OK) == 0;
    o.dir = fmt::format("{}/ledgerline-bench-{}", shared_memory ? "/dev/shm" : "/tmp", ::getpid());
  }
  o.paths.dir = fs::absolute(o.dir, error);
}

Status check(const Options& o) {
  const bool has_client = fs::exists(o.paths.programs / "two_way_client");
  if (const std::string build = build_or_prefix(); !has_client && fs::exists(fs::path(build) / "build.ninja"))
    return Error{"two_way_client is not built: ninja -C " + build + " two_way_client"};
  if (!has_client)
    return Error{"bench needs the source tree: " + (o.paths.programs / "two_way_client").string() + " is of its build"};
  const bool baselines = std::any_of(o.clients.begin(), o.clients.end(),
                                     [](const auto& id) { return find_competitor(id)->design != Design::ledgerline; });
  if (baselines && o.paths.node.empty()) return Error{"node is not on PATH: the baselines need Node.js 20.9 or newer"};
  const fs::path client = o.paths.npm / "node_modules/@hyperledger/fabric-gateway";
  if (baselines && !fs::exists(client)) {
    return Error{client.string() +
                 " is missing: ./run-tests installs it, or npm ci in a copy of tests/system/conformance"};
  }
  if (baselines && !fs::exists(o.paths.script)) return Error{o.paths.script.string() + " is missing"};
  const bool endorsers = std::any_of(o.clients.begin(), o.clients.end(), [](const auto& id) {
    return find_competitor(id)->endorser != Competitor::Endorser::none;
  });
  if (endorsers && o.paths.embedded)
    return Error{"an organisation's own endorser is for Fabric: the embedded node endorses within itself"};
  if (!o.paths.embedded && !fs::exists(o.paths.fabric / "peer")) {
    return Error{(o.paths.fabric / "peer").string() + " is missing: scripts/fabric-tools builds it"};
  }
  if (o.paths.embedded && !o.paths.network_options.empty()) {
    return Error{"--network is for Fabric: the embedded node knows no " + o.paths.network_options.front()};
  }
  if (fs::exists(o.paths.dir) && !fs::is_empty(o.paths.dir)) {
    return Error{o.paths.dir.string() + " is not empty; give a directory that is, or does not exist"};
  }
  return done;
}

/// Finds everything, or says what is missing.
Status prepare(Options& options) {
  find_programs(options);
  if (auto s = check(options); !s) return s;
  catch_stop_signals({SIGINT, SIGTERM, SIGHUP});
  std::signal(SIGPIPE, SIG_IGN);
  return done;
}

/// `given`: the directory was, so it stays.
int finish(const Status& status, const Options& options, bool given) {
  if (!status && stop_requests == 0) {
    spdlog::error("{} (logs and ledgers are left in {})", status.error().message, options.paths.dir.string());
    return 1;
  }
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(options.paths.dir, error)) fs::remove_all(entry.path(), error);
  if (!given) fs::remove(options.paths.dir, error);
  if (!status) spdlog::error("{}", status.error().message);
  return status ? 0 : 1;
}

/// Below a table.
std::string circumstances(const Options& o, const std::string& storage) {
  return fmt::format("{}, ledgers on {}; {} alternations of {:g} s after {:g} s of warm-up; {} cores\n",
                     o.ledger == "fabric" ? "Fabric" : "Embedded node", storage, o.alternations, o.seconds, o.warm_up_s,
                     launcher::describe_machine().cores);
}

int measure(Options& options) {
  const bool given = !options.dir.empty();
  if (auto s = prepare(options); !s) return fail(s.error());
  Measurement measurement(options, stop_requests);
  Status status = measurement.run();
  if (!measurement.runs().empty()) {
    fmt::print("{}\n{}", to_table(summarize(measurement.runs())), circumstances(options, measurement.storage()));
    if (auto written = measurement.write_json(); !written && status) status = written;
  }
  return finish(status, options, given);
}

void add_options(Verb verb, Options& o) {
  std::vector<std::string> ids;
  for (const Competitor& one : competitors()) {
    ids.push_back(one.id);
    if (!one.only_when_asked) o.clients.push_back(one.id);
  }
  verb.option("--rates", o.rates, "msg/s of both directions together").comma_list().within(2, 1100).shows_default();
  verb.option("--clients", o.clients, "Who is measured, see below").comma_list().one_of(ids).shows_default();
  verb.option("--poll-ms", o.paths.poll_ms, "Polling: pause between an answer and the next question")
      .within(0.0, 10'000.0)
      .shows_default();
  verb.option("--seconds", o.seconds, "Measured time of a run").within(0.5, 3600.0).shows_default();
  verb.option("--warm-up", o.warm_up_s, "Seconds before, left out").within(0.0, 600.0).shows_default();
  verb.option("--drain", o.drain_s, "Seconds that answers are awaited after it, at most")
      .within(0.5, 600.0)
      .shows_default();
  verb.option("--alternations", o.alternations, "How often all take turns; every other time in reverse order")
      .within(1, 1000)
      .shows_default();
  verb.option("--ledger", o.ledger, "fabric, or embedded for a quick look")
      .one_of({"fabric", "embedded"})
      .shows_default();
  verb.option("--network", o.paths.network_options,
              "One more word for `ledgerline fabric run`, for all clients: --network=--no-history")
      .one_at_a_time();
  verb.option("--dir", o.dir, "For ledgers and logs, empty or new [a new one under /dev/shm]");
  verb.option("--json", o.json, "Raw numbers and summary go here, after each run");
  verb.option("--fabric", o.paths.fabric, "Fabric's own programs [build/fabric]");
  verb.option("--npm", o.paths.npm, "Where node_modules is [build/npm]");
}

}  // namespace

int ledgerline::command::bench(int argc, char** argv) {
  CommandLine line("ledgerline bench", "Benchmarks against other designs", "");
  Options o;
  add_options(line.verb("two-way", about, notes), o);
  if (const auto end = line.parse(argc, argv)) return *end;
  return measure(o);
}
