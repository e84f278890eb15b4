#include "ground/core/flight/plan_timing.hpp"

#include <algorithm>

#include "common/msg/contract.hpp"

namespace ledgerline::ground {
namespace {

constexpr TimeNs min_plan_delay_ns = 10 * ns_per_ms;
constexpr TimeNs max_beyond_ns =
    contract::max_plan_ns - 100 * ns_per_ms;  // agent refuses what is later than the former
// Of the plans: there before their first setpoint's moment. More would make all of them for later, and what is not
// foreseen (gusts) grows with that; one that comes late only takes over late.
constexpr double in_time = 0.75;
constexpr double quick = 0.1;        // of the plans
constexpr double almost_all = 0.99;  // of the plans: what their length is for
constexpr std::size_t arrivals_needed = 8;

}  // namespace

void PlanTiming::submitted(std::size_t drone, std::uint64_t sequence, TimeNs made_ns) {
  auto& plans = drones_[drone].plans;
  plans[sequence % plans.size()] = {sequence, made_ns};
}

void PlanTiming::observe(std::size_t drone, const StateSample& s) {
  Drone& d = drones_[drone];
  if (s.applied_sequence != d.applied_sequence) d.margin.add(s.applied_late_ns);
  d.applied_sequence = s.applied_sequence;
  const auto made = [&](std::uint64_t sequence) {
    const PlanRecord& plan = d.plans[sequence % d.plans.size()];
    return sequence != 0 && plan.sequence == sequence ? std::optional(plan.made_ns) : std::nullopt;
  };
  if (s.arrived_sequence != d.arrived_sequence) {
    d.arrived_sequence = s.arrived_sequence;
    if (const auto made_ns = made(s.arrived_sequence)) d.arrivals.add(std::max<TimeNs>(0, s.arrived_ns - *made_ns));
    if (d.arrivals.size() >= arrivals_needed) {
      const auto at = [&](double q) { return d.arrivals.quantile(q).value_or(0); };
      d.timing = timing_for(at(quick), at(in_time), at(almost_all) - at(0.5));
    }
  } else if (const auto next_ns = made(s.arrived_sequence + 1);
             next_ns && s.stamp_ns - *next_ns > of(drone).delay_ns + overdue_ns) {
    d.arrivals = {};
    d.timing.reset();
  }
}

void PlanTiming::measure(TimeNs one_way_ns) {
  two_way_.add(one_way_ns);
  guess_ = timing_for(two_way_.own(quick), two_way_.quantile(in_time),
                      two_way_.quantile(almost_all) - two_way_.quantile(0.5));
}

PlanTiming::Timing PlanTiming::timing_for(TimeNs soonest_ns, TimeNs in_time_ns, TimeNs tail_ns) {
  Timing timing;
  // Long enough for two successors in a row that come as late as one of a hundred.
  timing.steps = std::min<std::size_t>(
      max_setpoints, PathController::steps + static_cast<std::size_t>(2 * tail_ns / PathController::step_ns));
  // After an outage the tail is long, and agent would refuse every plan that comes sooner: none may speak of more than
  // max_beyond_ns behind its arrival, be it as quick as one of ten. Shorter plans first (see Planner), then sooner ones.
  timing.farthest_ns = soonest_ns + max_beyond_ns;
  timing.delay_ns = std::min(std::clamp(in_time_ns, min_plan_delay_ns, max_plan_delay_ns),
                             timing.farthest_ns - static_cast<TimeNs>(PathController::steps) * PathController::step_ns);
  return timing;
}

void PlanTiming::begin_lease(std::size_t drone) {
  drones_[drone].plans = {};
  drones_[drone].arrivals = {};
  drones_[drone].timing.reset();
}

const PlanTiming::Timing& PlanTiming::of(std::size_t drone) const {
  return drones_[drone].timing ? *drones_[drone].timing : guess_;
}

TimeNs PlanTiming::max_delay_ns() const {
  TimeNs max_ns = 0;
  for (std::size_t drone = 0; drone < drones_.size(); ++drone) max_ns = std::max(max_ns, of(drone).delay_ns);
  return max_ns;
}

}  // namespace ledgerline::ground
