#include <algorithm>
#include <cmath>

#include "common/base/enum_count.hpp"
#include "common/msg/names.hpp"
#include "tools/report/results.hpp"

namespace ledgerline::report {
namespace {

constexpr TimeNs speed_over_ns = 300 * ns_per_ms;  // shorter, and a pose's noise is most of it

template <typename Enum>
std::string name_in(double number) {
  const bool known = number >= 0 && number < static_cast<double>(enum_count<Enum>);
  return std::string(known ? name(static_cast<Enum>(number)) : "unknown");
}

bool is_of(const TraceRecord& r, TraceKind kind, std::uint16_t drone, TimeNs begin_ns, TimeNs end_ns) {
  return r.kind == kind && r.drone == drone && r.t_ns >= begin_ns && r.t_ns <= end_ns;
}

}  // namespace

std::vector<FlownMoment> flown_moments(const std::vector<TraceRecord>& link, std::uint16_t drone, TimeNs begin_ns,
                                       TimeNs end_ns) {
  std::vector<FlownMoment> all;
  std::size_t before = 0;  // the newest that is speed_over_ns older
  for (const TraceRecord& r : link) {
    if (!is_of(r, TraceKind::state_sampled, drone, begin_ns, end_ns)) continue;
    const std::array position{r.v[0], r.v[1], r.v[2]};
    if (!std::isfinite(position[2])) continue;
    FlownMoment one{.t_s = to_seconds(r.t_ns - begin_ns), .position_m = position, .battery = r.extra / 1000.0};
    if (!all.empty() && one.t_s < all.back().t_s) continue;  // a link that was started again has another trace
    while (before + 1 < all.size() && all[before + 1].t_s <= one.t_s - to_seconds(speed_over_ns)) ++before;
    if (!all.empty() && one.t_s - all[before].t_s >= to_seconds(speed_over_ns)) {
      const std::array<double, 3>& from = all[before].position_m;
      one.speed_mps =
          std::hypot(position[0] - from[0], position[1] - from[1], position[2] - from[2]) / (one.t_s - all[before].t_s);
    }
    all.push_back(one);
  }
  return all;
}

std::vector<ModeChange> mode_changes(const std::vector<TraceRecord>& link, std::uint16_t drone, TimeNs begin_ns,
                                     TimeNs end_ns) {
  std::vector<ModeChange> all;
  for (const TraceRecord& r : link) {
    if (!is_of(r, TraceKind::mode, drone, begin_ns, end_ns)) continue;
    all.push_back({to_seconds(r.t_ns - begin_ns), name_in<LinkPhase>(static_cast<double>(r.id)),
                   name_in<FailsafeMode>(r.extra), name_in<FailsafeCause>(r.v[0])});
  }
  return all;
}

}  // namespace ledgerline::report
