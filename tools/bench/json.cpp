#include "common/rt/histogram.hpp"

#include <nlohmann/json.hpp>

#include "tools/bench/figures.hpp"

namespace ledgerline::two_way {

using nlohmann::json;

namespace {

json to_json(const std::optional<Spread>& s) {
  if (!s) return nullptr;
  return {{"median", rounded(s->median, 1e4)},
          {"low", rounded(s->low, 1e4)},
          {"high", rounded(s->high, 1e4)},
          {"count", s->count}};
}

}  // namespace

json to_json(const Turn& r) {
  json times = json::array();
  for (const double ms : r.times_ms) times.push_back(rounded(ms));
  const auto cpu = r.cpu_ms_per_message(), ledger_cpu = r.ledger_cpu_ms_per_message();
  return {{"client", r.competitor},
          {"rate", r.rate},
          {"alternation", r.alternation},
          {"position", r.position},
          {"p50_ms", rounded(r.quantile_ms(0.5))},
          {"p99_ms", rounded(r.quantile_ms(0.99))},
          {"cpu_ms_per_message", cpu ? json(rounded(*cpu, 1e4)) : json()},
          {"ledger_cpu_ms_per_message", ledger_cpu ? json(rounded(*ledger_cpu, 1e4)) : json()},
          {"sent", r.sent},
          {"answered", r.answered},
          {"replaced", r.replaced},
          {"lost", r.lost()},
          {"cpu_s", rounded(r.cpu_s, 1e6)},
          {"ledger_cpu_s", rounded(r.ledger_cpu_s, 1e6)},
          {"answers", r.answers},
          {"transactions", r.transactions},
          {"failed", r.failed},
          {"dropped", r.dropped},
          {"blocks", r.blocks},
          {"blocks_as_ordered", r.blocks_as_ordered},
          {"confirmed_after_ms", rounded(r.confirmed_after_ms)},
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
                         {"ledger_cpu_ms_per_message", to_json(f.ledger_cpu_ms_per_message)},
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
                      {"client", r.ours},
                      {"against", r.against},
                      {"p50", to_json(r.p50)},
                      {"p99", to_json(r.p99)},
                      {"cpu", to_json(r.cpu)},
                      {"ledger_cpu", to_json(r.ledger_cpu)}});
  }
  for (const auto& [id, rate] : summary.saturates_at) saturates[id] = rate ? json(*rate) : json();
  return {{"figures", figures}, {"ratios", ratios}, {"saturates_at", saturates}};
}

}  // namespace ledgerline::two_way
