#include "tools/bench/metrics.hpp"

#include <fmt/format.h>
#include <algorithm>

#include "common/rt/histogram.hpp"

namespace ledgerline::bench {
namespace {

constexpr double tolerated_share = 0.01;
constexpr double saturated_ms = 1000;
constexpr const char* usual_id = "ledgerline";  // what its other ways are compared with, too

using Value = std::optional<double> (*)(const Turn&);
std::optional<double> p50(const Turn& run) {
  return run.times_ms.empty() ? std::nullopt : std::optional(run.quantile_ms(0.5));
}
std::optional<double> p99(const Turn& run) {
  return run.times_ms.empty() ? std::nullopt : std::optional(run.quantile_ms(0.99));
}
std::optional<double> cpu(const Turn& run) { return run.cpu_ms_per_message(); }
std::optional<double> ledger_cpu(const Turn& run) { return run.ledger_cpu_ms_per_message(); }

using Turns = std::vector<const Turn*>;
Turns select(const std::vector<Turn>& runs, int rate, const std::string& competitor) {
  Turns found;
  for (const Turn& run : runs) {
    if (run.rate == rate && run.competitor == competitor) found.push_back(&run);
  }
  return found;
}

std::optional<Spread> spread(const Turns& runs, Value value) {
  std::vector<double> values;
  for (const Turn* run : runs) {
    if (const auto v = value(*run)) values.push_back(*v);
  }
  return spread_of(std::move(values));
}

std::optional<Spread> ratio(const Turns& ours, const Turns& theirs, Value value) {
  std::vector<double> ratios;
  for (const Turn* one : ours) {
    const auto other =
        std::find_if(theirs.begin(), theirs.end(), [&](const Turn* r) { return r->alternation == one->alternation; });
    if (other == theirs.end()) continue;
    const auto above = value(*one), below = value(**other);
    if (above && below && *below > 0) ratios.push_back(*above / *below);
  }
  return spread_of(std::move(ratios));
}

Metrics metrics_of(const Turns& runs) {
  Metrics f{.p50_ms = spread(runs, p50),
            .p99_ms = spread(runs, p99),
            .cpu_ms_per_message = spread(runs, cpu),
            .ledger_cpu_ms_per_message = spread(runs, ledger_cpu)};
  for (const Turn* run : runs) {
    f.sent += run->sent;
    f.answered += run->answered;
    f.replaced += run->replaced;
    f.lost += run->lost();
    ++f.runs;
    f.saturated += run->saturated();
    f.collapsed += run->collapsed();
  }
  return f;
}

/// "12.3 (11.0-14.9)" in about four digits.
std::string text(const std::optional<Spread>& s) {
  if (!s) return "-";
  const auto number = [](double v) { return fmt::format("{:.{}f}", v, v >= 100 ? 0 : v >= 10 ? 1 : 2); };
  if (s->count == 1) return number(s->median);
  return fmt::format("{} ({}-{})", number(s->median), number(s->low), number(s->high));
}

}  // namespace

const std::vector<Competitor>& competitors() {
  static const std::vector<Competitor> all{
      {"published", "published settings, gateway", Design::gateway, true, ""},
      {"ledgerline-published", "published settings, Ledgerline", Design::ledgerline, true, "libcrypto", true},
      {"gateway", "gateway", Design::gateway, false, ""},
      {"direct", "direct path", Design::direct, false, ""},
      {"polling", "gateway, polling", Design::polling, false, ""},
      {"ledgerline", "Ledgerline, libcrypto", Design::ledgerline, false, "libcrypto"},
      {"ledgerline-mbedtls", "Ledgerline, mbedTLS", Design::ledgerline, false, "mbedtls"},
      {"ledgerline-validated", "Ledgerline, validated", Design::ledgerline, false, "libcrypto", false, "peer", true},
      {"ledgerline-ordered", "Ledgerline, ordered", Design::ledgerline, false, "libcrypto", false, "ordered", true},
      {"endorser", "own endorser", Design::ledgerline, false, "libcrypto", true, "peer", true,
       Competitor::Endorser::beside},
      {"endorser-ordered", "own endorser, ordered", Design::ledgerline, false, "libcrypto", true, "ordered", true,
       Competitor::Endorser::beside},
      {"endorser-within-ordered", "own endorser within, ordered", Design::ledgerline, false, "libcrypto", true,
       "ordered", true, Competitor::Endorser::within},
  };
  return all;
}

const Competitor* find_competitor(const std::string& id) {
  const auto& all = competitors();
  const auto found = std::find_if(all.begin(), all.end(), [&](const Competitor& c) { return c.id == id; });
  return found == all.end() ? nullptr : &*found;
}

double Turn::quantile_ms(double q) const {
  if (times_ms.empty()) return 0;
  std::vector<double> times = times_ms;
  return quantile(times.begin(), times.end(), q);
}

std::optional<double> Turn::cpu_ms_per_message() const {
  if (answers == 0) return std::nullopt;
  return 1e3 * cpu_s / (2.0 * static_cast<double>(answers));
}

std::optional<double> Turn::ledger_cpu_ms_per_message() const {
  if (answers == 0) return std::nullopt;
  return 1e3 * ledger_cpu_s / (2.0 * static_cast<double>(answers));
}

bool Turn::saturated() const {
  return sent == 0 || static_cast<double>(sent - answered) > tolerated_share * static_cast<double>(sent) ||
         quantile_ms(0.99) > saturated_ms;
}

bool Turn::collapsed() const {
  return timed_out || static_cast<double>(lost()) > tolerated_share * static_cast<double>(sent);
}

std::optional<Spread> spread_of(std::vector<double> values) {
  if (values.empty()) return std::nullopt;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return Spread{median(values), *low, *high, static_cast<int>(values.size())};
}

Summary summarize(const std::vector<Turn>& runs) {
  Summary summary;
  for (const Turn& run : runs) summary.metrics[run.rate][run.competitor] = {};
  for (auto& [rate, of_rate] : summary.metrics) {
    for (auto& [id, metrics] : of_rate) metrics = metrics_of(select(runs, rate, id));
    for (const Competitor& one : competitors()) {
      if (one.design != Design::ledgerline || of_rate.count(one.id) == 0) continue;
      const Turns ours = select(runs, rate, one.id);
      for (const Competitor& baseline : competitors()) {
        const bool is_baseline = baseline.design != Design::ledgerline || baseline.id == usual_id;
        if (!is_baseline || baseline.id == one.id || of_rate.count(baseline.id) == 0) continue;
        const Turns theirs = select(runs, rate, baseline.id);
        summary.ratios.push_back({one.id, baseline.id, rate, ratio(ours, theirs, p50), ratio(ours, theirs, p99),
                                  ratio(ours, theirs, cpu), ratio(ours, theirs, ledger_cpu)});
      }
    }
  }
  for (const auto& [rate, of_rate] : summary.metrics) {
    for (const auto& [id, metrics] : of_rate) {
      auto& at = summary.saturates_at[id];
      if (!at && 2 * metrics.saturated >= metrics.runs) at = rate;
    }
  }
  return summary;
}

std::string to_table(const Summary& summary) {
  std::string out =
      fmt::format("\n{:>5}  {:<31}{:<22}{:<22}{:<20}{:<20}{:>8}{:>9}{:>9}{:>7}\n", "msg/s", "client", "p50, ms",
                  "p99, ms", "CPU, ms a message", "of the ledger", "sent", "answered", "replaced", "lost");
  for (const auto& [rate, of_rate] : summary.metrics) {
    for (const Competitor& one : competitors()) {
      const auto found = of_rate.find(one.id);
      if (found == of_rate.end()) continue;
      const Metrics& f = found->second;
      const std::string note = f.collapsed > 0 ? fmt::format("  collapsed {} of {}", f.collapsed, f.runs) : "";
      out += fmt::format("{:>5}  {:<31}{:<22}{:<22}{:<20}{:<20}{:>8}{:>9}{:>9}{:>7}{}\n", rate, one.title,
                         text(f.p50_ms), text(f.p99_ms), text(f.cpu_ms_per_message), text(f.ledger_cpu_ms_per_message),
                         f.sent, f.answered, f.replaced, f.lost, note);
    }
  }
  if (!summary.ratios.empty()) {
    out += fmt::format(
        "\nLedgerline / baseline, median (lowest-highest alternation)\n{:>5}  {:<31}{:<31}{:<22}{:<22}{:<22}{}\n",
        "msg/s", "client", "baseline", "p50", "p99", "CPU", "CPU of the ledger");
    for (const Ratios& r : summary.ratios) {
      out += fmt::format("{:>5}  {:<31}{:<31}{:<22}{:<22}{:<22}{}\n", r.rate, find_competitor(r.ours)->title,
                         find_competitor(r.against)->title, text(r.p50), text(r.p99), text(r.cpu), text(r.ledger_cpu));
    }
  }
  out += "\nSaturates at (of the rates measured)\n";
  for (const Competitor& one : competitors()) {
    const auto found = summary.saturates_at.find(one.id);
    if (found == summary.saturates_at.end()) continue;
    out += fmt::format("       {:<31}{}\n", one.title,
                       found->second ? fmt::format("{} msg/s", *found->second) : std::string("none"));
  }
  return out;
}

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
  json metrics = json::array(), ratios = json::array(), saturates = json::object();
  for (const auto& [rate, of_rate] : summary.metrics) {
    for (const auto& [id, f] : of_rate) {
      metrics.push_back({{"rate", rate},
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
  return {{"figures", metrics}, {"ratios", ratios}, {"saturates_at", saturates}};
}

}  // namespace ledgerline::bench
