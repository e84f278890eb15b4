#include "tools/bench/utm/figures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <tuple>

namespace ledgerline::utm {
namespace {

using nlohmann::json;
using two_way::Spread;

std::string text(const std::optional<Spread>& s) {
  if (!s) return "-";
  const auto number = [](double v) { return fmt::format("{:.{}f}", v, v >= 100 ? 0 : v >= 10 ? 1 : 2); };
  if (s->count == 1) return number(s->median);
  return fmt::format("{} ({}-{})", number(s->median), number(s->low), number(s->high));
}

json to_json(const std::optional<Spread>& s) {
  if (!s) return nullptr;
  return {{"median", s->median}, {"low", s->low}, {"high", s->high}, {"count", s->count}};
}

json number(const std::optional<double>& v) { return v ? json(*v) : json(); }

std::optional<Spread> spread(const std::vector<const Turn*>& runs, double q, std::vector<double> Turn::*times) {
  std::vector<double> values;
  for (const Turn* run : runs) {
    if (const auto v = quantile(run->*times, q)) values.push_back(*v);
  }
  return two_way::spread_of(std::move(values));
}

/// The baseline of that run: the same ledger settings, rate and alternation.
const Turn* gateway_beside(const std::vector<Turn>& runs, const Turn& run) {
  const auto found = std::find_if(runs.begin(), runs.end(), [&](const Turn& other) {
    return other.contender == "gateway" && other.settings == run.settings && other.rate == run.rate &&
           other.alternation == run.alternation;
  });
  return found == runs.end() ? nullptr : &*found;
}

}  // namespace

void Turn::count(End end, int attempts, std::uint64_t mvcc, double ms) {
  ++submitted;
  conflicts += mvcc;
  retried += attempts > 1 ? 1 : 0;
  if (end == End::registered) {
    ++registered;
    times_ms.push_back(ms);
  } else if (end == End::refused) {
    ++refused;
    refused_ms.push_back(ms);
  }
}

std::optional<double> quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::nullopt;
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size())));
  return values[std::clamp<std::size_t>(rank, 1, values.size()) - 1];
}

std::vector<Figures> summarize(const std::vector<Turn>& runs) {
  std::vector<Figures> all;
  for (const Turn& run : runs) {
    const auto same = [&](const auto& f) {
      return f.contender == run.contender && f.settings == run.settings && f.rate == run.rate;
    };
    if (std::any_of(all.begin(), all.end(), same)) continue;
    Figures f{.contender = run.contender, .settings = run.settings, .rate = run.rate};
    std::vector<const Turn*> mine;
    std::vector<double> per_s, ratios;
    for (const Turn& one : runs) {
      if (!same(one)) continue;
      mine.push_back(&one);
      ++f.runs;
      f.submitted += one.submitted;
      f.registered += one.registered;
      f.refused += one.refused;
      f.retried += one.retried;
      f.conflicts += one.conflicts;
      f.lost += one.lost();
      per_s.push_back(one.registered_per_s());
      const Turn* gateway = gateway_beside(runs, one);
      const auto ours = quantile(one.times_ms, 0.5);
      const auto theirs = gateway ? quantile(gateway->times_ms, 0.5) : std::nullopt;
      if (gateway != &one && ours && theirs && *theirs > 0) ratios.push_back(*ours / *theirs);
    }
    f.p50_ms = spread(mine, 0.5, &Turn::times_ms);
    f.p95_ms = spread(mine, 0.95, &Turn::times_ms);
    f.p99_ms = spread(mine, 0.99, &Turn::times_ms);
    f.refused_p50_ms = spread(mine, 0.5, &Turn::refused_ms);
    f.registered_per_s = two_way::spread_of(std::move(per_s));
    f.p50_of_gateway = two_way::spread_of(std::move(ratios));
    all.push_back(std::move(f));
  }
  std::stable_sort(all.begin(), all.end(), [](const Figures& a, const Figures& b) {
    return std::tie(a.settings, a.rate, a.contender) < std::tie(b.settings, b.rate, b.contender);
  });
  return all;
}

std::string to_table(const std::vector<Figures>& figures) {
  std::string out = fmt::format("\n{:<9}{:>5}  {:<12}{:<20}{:<20}{:<20}{:<18}{:>10}{:>11}{:>9}{:>9}{:>11}{:>6}\n",
                                "settings", "in/s", "client", "p50, ms", "p95, ms", "p99, ms", "registered/s",
                                "submitted", "registered", "refused", "retried", "conflicts", "lost");
  for (const Figures& f : figures) {
    out += fmt::format("{:<9}{:>5}  {:<12}{:<20}{:<20}{:<20}{:<18}{:>10}{:>11}{:>9}{:>9}{:>11}{:>6}\n", f.settings,
                       f.rate, f.contender, text(f.p50_ms), text(f.p95_ms), text(f.p99_ms), text(f.registered_per_s),
                       f.submitted, f.registered, f.refused, f.retried, f.conflicts, f.lost);
  }
  const bool compared = std::any_of(figures.begin(), figures.end(), [](const auto& f) { return f.p50_of_gateway; });
  if (compared) out += "\np50 divided by gateway's, median (lowest-highest alternation)\n";
  for (const Figures& f : figures) {
    if (f.p50_of_gateway)
      out += fmt::format("{:<9}{:>5}  {:<12}{}\n", f.settings, f.rate, f.contender, text(f.p50_of_gateway));
  }
  return out + "\nPublished (arXiv 2511.02171, its own network and machines): more than 3 s median above 30 tx/s\n";
}

json to_json(const Turn& r) {
  return {{"client", r.contender},
          {"settings", r.settings},
          {"rate", r.rate},
          {"alternation", r.alternation},
          {"position", r.position},
          {"submitted", r.submitted},
          {"registered", r.registered},
          {"refused", r.refused},
          {"retried", r.retried},
          {"conflicts", r.conflicts},
          {"lost", r.lost()},
          {"p50_ms", number(quantile(r.times_ms, 0.5))},
          {"p95_ms", number(quantile(r.times_ms, 0.95))},
          {"p99_ms", number(quantile(r.times_ms, 0.99))},
          {"refused_p50_ms", number(quantile(r.refused_ms, 0.5))},
          {"registered_per_s", r.registered_per_s()},
          {"timed_out", r.timed_out},
          {"why", r.why},
          {"latencies_ms", r.times_ms}};
}

json to_json(const std::vector<Figures>& figures) {
  json all = json::array();
  for (const Figures& f : figures) {
    all.push_back({{"client", f.contender},
                   {"settings", f.settings},
                   {"rate", f.rate},
                   {"runs", f.runs},
                   {"submitted", f.submitted},
                   {"registered", f.registered},
                   {"refused", f.refused},
                   {"retried", f.retried},
                   {"conflicts", f.conflicts},
                   {"lost", f.lost},
                   {"p50_ms", to_json(f.p50_ms)},
                   {"p95_ms", to_json(f.p95_ms)},
                   {"p99_ms", to_json(f.p99_ms)},
                   {"refused_p50_ms", to_json(f.refused_p50_ms)},
                   {"registered_per_s", to_json(f.registered_per_s)},
                   {"p50_of_gateway", to_json(f.p50_of_gateway)}});
  }
  return all;
}

}  // namespace ledgerline::utm
