#include "tools/bench/measurement.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>

#include "chaincode/node/storage/files.hpp"
#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/rt/histogram.hpp"
#include "tools/launcher/machine.hpp"

namespace ledgerline::bench {

using nlohmann::json;

Status Measurement::run() {
  std::error_code error;
  std::filesystem::create_directories(o_.paths.dir, error);
  const auto storage = node::storage_kind(o_.paths.dir);
  if (!storage) return storage.error();
  storage_ = *storage;
  for (int alternation = 0; alternation < o_.alternations; ++alternation) {
    for (const int rate : o_.rates) {
      position_ = 0;
      std::vector<const Competitor*> order;
      for (const std::string& id : o_.clients) order.push_back(find_competitor(id));
      if (alternation % 2 == 1) std::reverse(order.begin(), order.end());
      for (auto from = order.begin(); from != order.end();) {
        const auto to = std::find_if(from, order.end(), [&](const auto* c) {
          return Network::settings_for(*c) != Network::settings_for(**from);
        });
        if (auto s = group({from, to}, rate, alternation); !s) return s;
        from = to;
      }
    }
  }
  return done;
}

Status write_result(const std::string& file, json head, const std::vector<json>& runs) {
  if (file.empty()) return done;
  const launcher::Machine machine = launcher::describe_machine();
  head["machine"] = {{"cpu", machine.cpu},
                     {"system", machine.system},
                     {"cores", machine.cores},
                     {"memory_gb", rounded(machine.memory_gb)}};
  std::string text = head.dump(1);
  text.resize(text.size() - 2);  // "\n}": the runs follow, one a line
  text += ",\n \"runs\": [";
  for (std::size_t i = 0; i < runs.size(); ++i) text += (i > 0 ? ",\n  " : "\n  ") + runs[i].dump();
  return write_file(file, text + "\n ]\n}\n");
}

Status Measurement::write_json() const {
  const json head{{"asked",
                   {{"rates", o_.rates},
                    {"clients", o_.clients},
                    {"alternations", o_.alternations},
                    {"seconds", o_.seconds},
                    {"warm_up_s", o_.warm_up_s},
                    {"drain_s", o_.drain_s},
                    {"network_options", o_.paths.network_options},
                    {"poll_ms", o_.paths.poll_ms}}},
                  {"ledger", {{"kind", o_.ledger}, {"storage", storage_}, {"networks", networks_}}},
                  {"summary", to_json(summarize(runs_))}};
  return write_result(o_.json, head, lines_of(runs_));
}

// Competitors on one network; a new one after a collapse, so that nobody finds another's backlog.
Status Measurement::group(const std::vector<const Competitor*>& competitors, int rate, int alternation) {
  std::optional<Network> network;
  const Network::Settings settings = Network::settings_for(*competitors.front());
  for (const Competitor* competitor : competitors) {
    if (!network) {
      network.emplace(o_.paths, settings, o_.paths.dir / fmt::format("network{}", ++directories_), interrupts_);
      if (auto s = network->up(); !s) return s;
    }
    const Schedule schedule = make_schedule(rate, o_.warm_up_s, o_.seconds, o_.drain_s);
    auto run = exchange(o_.paths, *network, *competitor, schedule,
                        o_.paths.dir / fmt::format("run{}", runs_.size() + 1), interrupts_);
    if (!run) return run.error();
    run->rate = rate;
    run->alternation = alternation;
    run->position = position_++;
    log(*run);
    runs_.push_back(std::move(*run));
    if (runs_.back().collapsed() || competitor == competitors.back()) {
      if (auto s = end(*network, settings); !s) return s;
      network.reset();
    }
    if (auto s = write_json(); !s) return s;
  }
  return done;
}

Status Measurement::end(Network& network, const Network::Settings& settings) {
  auto summary = network.down();
  if (!summary) return summary.error();
  (*summary)["orderers"] = settings.orderers;
  (*summary)["batch_count"] = settings.batch_count;
  (*summary)["batch_timeout_ms"] = settings.batch_timeout_ms;
  (*summary)["peers_in_background"] = settings.peers_in_background;
  networks_.push_back(std::move(*summary));
  std::error_code error;
  std::filesystem::remove_all(o_.paths.dir / fmt::format("network{}", directories_), error);
  return done;
}

void Measurement::log(const Turn& r) const {
  const auto cpu = r.cpu_ms_per_message();
  spdlog::info("{}/{} {:>4} msg/s  {:<31} p50 {:.1f} ms, p99 {:.1f} ms, CPU {:.2f} ms a message, {} of {} answered{}{}",
               r.alternation + 1, o_.alternations, r.rate, find_competitor(r.competitor)->title, r.quantile_ms(0.5),
               r.quantile_ms(0.99), cpu.value_or(0), r.answered, r.sent, r.collapsed() ? ", collapsed" : "",
               r.why.empty() ? "" : " (" + r.why + ")");
}

}  // namespace ledgerline::bench
