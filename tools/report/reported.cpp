#include <algorithm>
#include <cmath>
#include <map>

#include "tools/report/results.hpp"

namespace ledgerline::report {
namespace {

struct Truth {
  TimeNs t_ns = 0;
  std::array<double, 2> at_m{};
  bool in_flight = false;
};

// Of the simulator's 30 a second; further apart it is not known what was between.
constexpr TimeNs max_gap_ns = 200 * ns_per_ms;

std::vector<Truth> truth_of(const std::vector<TraceRecord>& trace, std::uint16_t drone) {
  std::vector<Truth> all;
  for (const TraceRecord& r : trace) {
    if (r.kind == TraceKind::truth && r.drone == drone) all.push_back({r.t_ns, {r.v[0], r.v[1]}, r.extra == 1});
  }
  std::stable_sort(all.begin(), all.end(), [](const Truth& a, const Truth& b) { return a.t_ns < b.t_ns; });
  return all;
}

// Between the two records around it; nothing where there are none, or it stands on the ground.
std::optional<std::array<double, 2>> flying_at(const std::vector<Truth>& truth, TimeNs t_ns) {
  const auto after = std::lower_bound(truth.begin(), truth.end(), t_ns,
                                      [](const Truth& one, TimeNs wanted) { return one.t_ns < wanted; });
  if (after == truth.begin() || after == truth.end()) return std::nullopt;
  const Truth &a = *std::prev(after), &b = *after;
  if (!a.in_flight || !b.in_flight || b.t_ns - a.t_ns > max_gap_ns) return std::nullopt;
  const double share = static_cast<double>(t_ns - a.t_ns) / static_cast<double>(std::max<TimeNs>(1, b.t_ns - a.t_ns));
  return std::array{std::lerp(a.at_m[0], b.at_m[0], share), std::lerp(a.at_m[1], b.at_m[1], share)};
}

}  // namespace

std::vector<ReportedPosition> reported_positions(const std::vector<TraceRecord>& link,
                                                 const std::vector<TraceRecord>& truth, std::uint16_t drone,
                                                 TimeNs begin_ns) {
  // By the moment that it was sampled, which both records have: a link that is started again counts from one again.
  std::map<TimeNs, std::array<double, 2>> sampled;
  for (const TraceRecord& r : link)
    if (r.kind == TraceKind::state_sampled && r.drone == drone) sampled[r.t_ns] = {r.v[0], r.v[1]};
  const std::vector<Truth> real = truth_of(truth, drone);
  std::vector<ReportedPosition> all;
  for (const TraceRecord& r : link) {
    if (r.kind != TraceKind::pose_reported || r.drone != drone || r.t_ns < begin_ns) continue;
    const double worst_m2 = std::max(r.v[0], r.v[1]);
    const auto reported = sampled.find(r.t_ns);
    if (!(worst_m2 > 0) || !std::isfinite(worst_m2) || reported == sampled.end()) continue;
    ReportedPosition one{.t_s = to_seconds(r.t_ns - begin_ns), .three_sigma_m = 3 * std::sqrt(worst_m2)};
    const auto at_m = flying_at(real, r.stamp_ns);
    if (!real.empty() && !at_m) continue;  // on the ground
    if (at_m) one.error_m = std::hypot(reported->second[0] - (*at_m)[0], reported->second[1] - (*at_m)[1]);
    all.push_back(one);
  }
  return all;
}

std::optional<ReportedMetrics> metrics_of(const std::vector<ReportedPosition>& reported) {
  if (reported.empty()) return std::nullopt;
  ReportedMetrics metrics{.count = reported.size()};
  double squares = 0;
  std::size_t measured = 0, inside = 0;
  for (const ReportedPosition& one : reported) {
    metrics.max_three_sigma_m = std::max(metrics.max_three_sigma_m, one.three_sigma_m);
    if (!one.error_m) continue;
    ++measured;
    squares += *one.error_m * *one.error_m;
    metrics.max_error_m = std::max(metrics.max_error_m.value_or(0), *one.error_m);
    if (*one.error_m <= one.three_sigma_m) ++inside;
  }
  if (measured == 0) return metrics;
  metrics.rms_error_m = std::sqrt(squares / static_cast<double>(measured));
  metrics.inside = static_cast<double>(inside) / static_cast<double>(measured);
  return metrics;
}

}  // namespace ledgerline::report
