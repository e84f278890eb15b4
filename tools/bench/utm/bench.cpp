#include "tools/bench/utm/bench.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <csignal>

#include "chaincode/node/storage/files.hpp"
#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/process/children.hpp"

namespace ledgerline::utm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using two_way::Network;

constexpr TimeNs watch_ns = 50 * ns_per_ms;
constexpr TimeNs start_limit_ns = 30 * ns_per_s, patience_ns = 5 * ns_per_s;
constexpr double overtime_s = 10;
constexpr int log_lines = 8;
constexpr int max_in_flight = 1000, deadline_ms = 60'000;  // as node/utm.cjs bounds a call

/// A contender's client, once, and what it has said so far.
class Process {
 public:
  Process(const two_way::Place& place, const Network& network, fs::path dir, const std::atomic<int>& interrupts)
      : place_(place),
        access_(network.access(1)),
        dir_(std::move(dir)),
        interrupts_(interrupts),
        children_({[this](const std::string&, const std::string& line) { take(line); }}) {}

  Result<Turn> run(const std::string& contender, const Job& job) {
    std::error_code error;
    fs::create_directories(dir_, error);
    if (auto s = write_file(dir_ / "job.json", to_json(job).dump()); !s) return s.error();
    Children::Program program{"client", {}, dir_ / "client.log", SIGKILL};
    if (contender == "gateway") {
      const json ledger{{"endpoint", access_.endpoint},
                        {"tlsCa", access_.tls_ca},
                        {"mspId", access_.msp_id},
                        {"mspDir", access_.msp_dir}};
      program.command = {place_.node, place_.script.parent_path() / "utm.cjs", dir_ / "job.json", ledger.dump()};
      program.environment = {"NODE_PATH=" + (place_.npm / "node_modules").string()};
    } else {
      if (auto s = write_file(dir_ / "client.toml", client_config()); !s) return s.error();
      program.command = {place_.programs / "utm_client", "--config", dir_ / "client.toml", "--job", dir_ / "job.json"};
    }
    if (auto s = children_.start(program); !s) return s.error();
    const double length_s = (job.intents.empty() ? 0 : to_seconds(job.intents.back().at_ns)) + job.drain_s;
    const TimeNs until_ns = monotonic_ns() + start_limit_ns + from_seconds(length_s + overtime_s);
    while (children_.running("client") && monotonic_ns() < until_ns) {
      if (interrupts_ > 0) return Error{"interrupted"};
      children_.poll(watch_ns);
    }
    turn_.timed_out = children_.running("client");
    if (turn_.timed_out) children_.stop("client", patience_ns);
    children_.poll(0);  // what it said last
    if (!ready_ || !complete_) {
      return Error{fmt::format("{}: the client {}. The end of {}:\n{}", contender, children_.how_it_ended("client"),
                               (dir_ / "client.log").string(), children_.log_tail("client", log_lines))};
    }
    if (to_ms_ > from_ms_) turn_.length_s = (to_ms_ - from_ms_) / 1e3;
    return turn_;
  }

 private:
  std::string client_config() const {
    std::string text = fmt::format(
        "[ledger]\nendpoint = \"{}\"\ntls_ca = \"{}\"\nmsp_id = \"{}\"\nmsp_dir = \"{}\"\nsigner = \"libcrypto\"\n"
        "max_in_flight = {}\ndeadline_ms = {}\n",
        access_.endpoint, access_.tls_ca, access_.msp_id, access_.msp_dir, max_in_flight, deadline_ms);
    for (const std::string& orderer : access_.orderers) {
      text += fmt::format("\n[[orderer]]\nendpoint = \"{}\"\ntls_ca = \"{}\"\n", orderer, access_.orderer_tls_ca);
    }
    const std::vector<std::string> organisations{access_.msp_id, "Org2MSP"};
    for (std::size_t i = 0; i < organisations.size(); ++i) {
      text += fmt::format("\n[[endorser]]\nmsp_id = \"{}\"\nendpoint = \"{}\"\ntls_ca = \"{}\"\n", organisations[i],
                          access_.endorsers[i].endpoint, access_.endorsers[i].tls_ca);
    }
    return text;
  }

  void take(const std::string& text) {
    const json line = json::parse(text, nullptr, false);
    if (!line.is_object()) return;
    if (line.contains("ready")) ready_ = true;
    if (line.contains("result")) {
      complete_ = true;
      turn_.why = line["result"].value("why", "");
    }
    if (!line.contains("ended") || !line["ended"].is_array()) return;
    for (const json& one : line["ended"]) {
      if (!one.is_array() || one.size() != 5 || !one[0].is_string()) continue;
      const End end = one[0] == "registered" ? End::registered : one[0] == "refused" ? End::refused : End::lost;
      const double from_ms = one[3].get<double>(), to_ms = one[4].get<double>();
      turn_.count(end, one[1].get<int>(), one[2].get<std::uint64_t>(), to_ms - from_ms);
      from_ms_ = turn_.submitted == 1 ? from_ms : std::min(from_ms_, from_ms);
      to_ms_ = std::max(to_ms_, to_ms);
    }
  }

  const two_way::Place& place_;
  const Network::Access access_;
  fs::path dir_;
  const std::atomic<int>& interrupts_;
  Turn turn_;
  bool ready_ = false, complete_ = false;
  double from_ms_ = 0, to_ms_ = 0;
  Children children_;
};

}  // namespace

Network::Settings settings_of(const std::string& name) {
  if (name == "stock") return {.orderers = 1, .batch_count = 500, .batch_timeout_ms = 2000};
  return {};
}

Status Bench::run() {
  std::error_code error;
  fs::create_directories(o_.common.place.dir, error);
  const auto storage = node::storage_kind(o_.common.place.dir);
  if (!storage) return storage.error();
  storage_ = *storage;
  for (int alternation = 0; alternation < o_.common.alternations; ++alternation) {
    for (const std::string& settings : o_.settings) {
      if (auto s = on_network(settings, alternation); !s) return s;
    }
  }
  return done;
}

Status Bench::on_network(const std::string& settings, int alternation) {
  const Network::Settings cut = settings_of(settings);
  const fs::path dir = o_.common.place.dir / fmt::format("network{}", networks_.size() + 1);
  Network network(o_.common.place, cut, dir, interrupts_);
  if (auto s = network.up(); !s) return s;
  std::vector<std::string> order = o_.common.clients;
  if (alternation % 2 == 1) std::reverse(order.begin(), order.end());
  for (const int rate : o_.common.rates) {
    for (std::size_t position = 0; position < order.size(); ++position) {
      auto one = turn(network, order[position], rate, alternation);
      if (!one) return one.error();
      one->settings = settings;
      one->position = static_cast<int>(position);
      spdlog::info("{}/{} {} {:>3}/s {:<11} p50 {:.1f} ms; {} of {} registered, {} refused, {} conflicts, {} lost{}",
                   alternation + 1, o_.common.alternations, settings, rate, one->contender,
                   quantile(one->times_ms, 0.5).value_or(0), one->registered, one->submitted, one->refused,
                   one->conflicts, one->lost(), one->lost() > 0 && !one->why.empty() ? " (" + one->why + ")" : "");
      runs_.push_back(std::move(*one));
      if (auto s = write_json(); !s) return s;
    }
  }
  auto summary = network.down();
  if (!summary) return summary.error();
  (*summary)["settings"] = settings;
  (*summary)["orderers"] = cut.orderers;
  (*summary)["batch_count"] = cut.batch_count;
  (*summary)["batch_timeout_ms"] = cut.batch_timeout_ms;
  networks_.push_back(std::move(*summary));
  std::error_code error;
  fs::remove_all(dir, error);
  return write_json();
}

Result<Turn> Bench::turn(const Network& network, const std::string& contender, int rate, int alternation) {
  // The same intents for every contender, each in an airspace of its own.
  WorkloadOptions w = o_.workload;
  w.seed += static_cast<std::uint64_t>(alternation);
  w.poisson = !o_.evenly;
  w.rate_per_s = rate;
  w.warm_up_s = o_.common.warm_up_s;
  w.seconds = o_.common.seconds;
  w.airspace = fmt::format("utm{}", runs_.size() + 1);
  const Job job{
      .intents = make_workload(w), .retry = {.attempts = o_.attempts}, .drain_s = o_.common.drain_s, .seed = w.seed};
  Process process(o_.common.place, network, o_.common.place.dir / fmt::format("run{}", runs_.size() + 1), interrupts_);
  auto turn = process.run(contender, job);
  if (!turn) return turn.error();
  turn->contender = contender;
  turn->rate = rate;
  turn->alternation = alternation;
  return turn;
}

Status Bench::write_json() const {
  const json head{{"asked",
                   {{"rates", o_.common.rates},
                    {"clients", o_.common.clients},
                    {"settings", o_.settings},
                    {"alternations", o_.common.alternations},
                    {"seconds", o_.common.seconds},
                    {"warm_up_s", o_.common.warm_up_s},
                    {"drain_s", o_.common.drain_s},
                    {"network_options", o_.common.place.network_options},
                    {"seed", o_.workload.seed},
                    {"overlapping", o_.workload.overlapping},
                    {"racing", o_.workload.racing},
                    {"suppliers", o_.workload.suppliers},
                    {"evenly", o_.evenly},
                    {"attempts", o_.attempts}}},
                  {"published", {{"source", "arXiv 2511.02171"}, {"p50_above_ms", 3000}, {"above_per_s", 30}}},
                  {"ledger", {{"kind", o_.common.ledger}, {"storage", storage_}, {"networks", networks_}}},
                  {"summary", to_json(summarize(runs_))}};
  return two_way::write_result(o_.common.json, head, two_way::lines_of(runs_));
}

}  // namespace ledgerline::utm
