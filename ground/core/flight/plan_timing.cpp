#include "ground/core/flight/plan_timing.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/msg/contract.hpp"
#include "common/rt/histogram.hpp"

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
// So many arrivals say enough, or those of so long: a ledger that cuts a block each second brings eight only after
// link has landed the drone (FS-05, 5 s). Half takes two plans of a far ledger's first second for all of them.
constexpr std::size_t arrivals_needed = 8;
constexpr TimeNs arrivals_needed_ns = 2 * ns_per_s;
constexpr double mostly = 0.9;  // of the spacings: an outage is none

}  // namespace

void Window::add(TimeNs t_ns) { samples_[count_++ % kept] = t_ns; }

std::optional<TimeNs> Window::quantile(double q) const {
  if (count_ == 0) return std::nullopt;
  auto samples = samples_;
  return ledgerline::quantile(samples.begin(), samples.begin() + static_cast<std::ptrdiff_t>(size()), q);
}

void RoundTripEstimate::add(TimeNs submission_to_block_ns) { ways_.add(std::max<TimeNs>(0, submission_to_block_ns)); }

TimeNs RoundTripEstimate::quantile(double q) const {
  const std::size_t n = ways_.size();
  if (n == 0) return unknown_ns;
  const auto& ways = ways_.samples();
  std::vector<TimeNs> sums;
  sums.reserve(n * n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < n; ++k) sums.push_back(ways[i] + ways[k]);
  }
  return ledgerline::quantile(sums.begin(), sums.end(), q);
}

void PlanTiming::submitted(std::size_t drone, std::uint64_t sequence, TimeNs made_ns) {
  auto& plans = drones_[drone].plans;
  plans[sequence % plans.size()] = {sequence, made_ns};
}

void PlanTiming::observe(std::size_t drone, const StateSample& s) {
  Drone& d = drones_[drone];
  const auto made = [&](std::uint64_t sequence) {
    const PlanRecord& plan = d.plans[sequence % d.plans.size()];
    return sequence != 0 && plan.sequence == sequence ? std::optional(plan.made_ns) : std::nullopt;
  };
  if (s.arrived_sequence != d.arrived_sequence) {
    d.arrived_sequence = s.arrived_sequence;
    if (const auto made_ns = made(s.arrived_sequence)) add_arrival(d, s.arrived_ns, s.arrived_ns - *made_ns);
  } else if (const auto next_ns = made(s.arrived_sequence + 1);
             next_ns && s.stamp_ns - *next_ns > of(drone).delay_ns + overdue_ns) {
    forget_arrivals(d);
  }
}

void PlanTiming::add_arrival(Drone& drone, TimeNs arrived_ns, TimeNs took_ns) {
  drone.arrivals.add(std::max<TimeNs>(0, took_ns));
  if (drone.first_arrival_ns == 0) {
    drone.first_arrival_ns = arrived_ns;
  } else {
    drone.spacings.add(std::max<TimeNs>(0, arrived_ns - drone.last_arrival_ns));
  }
  drone.last_arrival_ns = arrived_ns;
  if (drone.arrivals.size() < arrivals_needed && arrived_ns - drone.first_arrival_ns < arrivals_needed_ns) return;
  const auto at = [&](double q) { return drone.arrivals.quantile(q).value_or(0); };
  drone.timing = timing_for({.soonest_ns = at(quick),
                             .in_time_ns = at(in_time),
                             .tail_ns = at(almost_all) - at(0.5),
                             .spacing_ns = drone.spacings.quantile(mostly).value_or(0)});
}

void PlanTiming::forget_arrivals(Drone& drone) {
  drone.arrivals = drone.spacings = {};
  drone.first_arrival_ns = drone.last_arrival_ns = 0;
  drone.timing.reset();
}

Status PlanTiming::check_delay() const {
  const TimeNs ways_ns = two_way_.quantile(in_time);
  if (ways_ns <= max_plan_delay_ns) return done;
  return Error{
      fmt::format("the ledger is too slow: a state and its command take {:.1f} s, and plans reach {:.0f} s ahead",
                  to_seconds(ways_ns), to_seconds(max_plan_delay_ns))};
}

void PlanTiming::measure(TimeNs one_way_ns) {
  two_way_.add(one_way_ns);
  guess_.reset();
}

const PlanTiming::Timing& PlanTiming::guess() const {
  if (!guess_)
    guess_ = timing_for({.soonest_ns = two_way_.own(quick),
                         .in_time_ns = two_way_.quantile(in_time),
                         .tail_ns = two_way_.quantile(almost_all) - two_way_.quantile(0.5)});
  return *guess_;
}

PlanTiming::Timing PlanTiming::timing_for(const Ways& ways) {
  Timing timing;
  // Long enough for two successors in a row that come as late as one of a hundred, and until the next one where plans
  // come seldom.
  const auto steps = [](TimeNs length_ns) { return static_cast<std::size_t>(length_ns / PathController::step_ns); };
  timing.steps = std::min<std::size_t>(max_setpoints, std::max(PathController::steps + steps(2 * ways.tail_ns),
                                                               steps(ways.spacing_ns + ways.tail_ns) + 1));
  // After an outage the tail is long, and agent would refuse every plan that comes sooner: none may speak of more than
  // max_beyond_ns behind its arrival, be it as quick as one of ten. Shorter plans first (see Planner), then sooner
  // ones.
  timing.farthest_ns = ways.soonest_ns + max_beyond_ns;
  timing.delay_ns = std::min(std::clamp(ways.in_time_ns, min_plan_delay_ns, max_plan_delay_ns),
                             timing.farthest_ns - static_cast<TimeNs>(PathController::steps) * PathController::step_ns);
  return timing;
}

void PlanTiming::begin_lease(std::size_t drone) {
  drones_[drone].plans = {};
  forget_arrivals(drones_[drone]);
}

const PlanTiming::Timing& PlanTiming::of(std::size_t drone) const {
  return drones_[drone].timing ? *drones_[drone].timing : guess();
}

TimeNs PlanTiming::max_delay_ns() const {
  TimeNs max_ns = 0;
  for (std::size_t drone = 0; drone < drones_.size(); ++drone) max_ns = std::max(max_ns, of(drone).delay_ns);
  return max_ns;
}

}  // namespace ledgerline::ground
