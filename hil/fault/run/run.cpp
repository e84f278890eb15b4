#include "hil/fault/run/run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <thread>

#include "common/msg/names.hpp"
#include "hil/fault/own_code.hpp"
#include "hil/fault/run/schedule.hpp"
#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {
namespace {

// How far the fence may be off, since link's own estimate is off. Without motion capture nobody sees what a drone's own
// senses hide, and it stays behind the fault: what it had time to become, and no more. (How wrong they are without a
// fault needs no room: by so much link draws the fence in.)
double misled_m(const Script& script) {
  const bool by_odometry = script.flight.pose != link::PoseSource::mocap;
  double metres = 0;
  for (const Fault& fault : script.faults) {
    metres += fault.acts.misleads_m;
    const TimeNs lasts_ns = fault.for_ns > 0 ? fault.for_ns : script.limit_ns;
    if (by_odometry) metres += fault.acts.misleads_mps * to_seconds(lasts_ns);
  }
  return metres;
}

/// What became of a drone's plans, in words: agent's refusals and link's counters, of those that run now.
std::string plans_text(const SimulatedWorld& world, std::size_t drone) {
  std::string text;
  if (const agent::AgentCore* agent = world.agent()) {
    const auto commands = agent->report(world.drones()[drone].number).commands;
    text += fmt::format("agent: {} on the ledger, {} verified", commands.on_ledger, commands.verified);
    for (std::size_t i = 0; i < agent::refusal_count; ++i) {
      if (commands.reasons[i] > 0)
        text += fmt::format(", {} {}", commands.reasons[i], agent::refusal_name(static_cast<agent::RefusalReason>(i)));
    }
  }
  if (const link::LinkCore* link = world.link()) {
    const link::PlanCounters plans = link->reports()[drone].plans;
    text += fmt::format("{}link: {} received, {} applied, {} late, {} dropped", text.empty() ? "" : "; ",
                        plans.received, plans.applied, plans.late, plans.dropped);
  }
  return text;
}

TimelinePoint point_of(TimeNs now, const DroneObservation& observation) {
  TimelinePoint point;
  point.t_ns = now;
  for (std::size_t i = 0; i < 3; ++i) {
    point.at_m[i] = static_cast<float>(observation.truth.position_m[i]);
    if (observation.pose) point.estimated_m[i] = static_cast<float>(observation.pose->position_m[i]);
  }
  point.sent_mps = static_cast<float>(observation.sent_mps);
  point.phase = observation.phase;
  point.mode = observation.mode;
  point.cause = observation.cause;
  point.lap = static_cast<std::uint8_t>(std::min(observation.lap, 255));
  return point;
}

}  // namespace

Limits limits_of(const Script& script, const std::vector<DroneObservation>& drones) {
  std::vector<std::array<double, 2>> starts_m;
  for (const DroneObservation& drone : drones) starts_m.push_back(drone.start_m);
  const link::FenceSettings fence = fence_around(script.flight, starts_m);
  const double slack = 1.5 + misled_m(script);
  Limits limits;
  limits.height_m += misled_m(script);
  limits.fence_min_m = fence.min_m;
  limits.fence_max_m = fence.max_m;
  for (std::size_t i = 0; i < 2; ++i) {
    limits.min_m[i] = fence.min_m[i] - slack;
    limits.max_m[i] = fence.max_m[i] + slack;
  }
  return limits;
}

std::vector<std::string> in_the_air(const std::vector<DroneObservation>& drones) {
  std::vector<std::string> names;
  for (const DroneObservation& drone : drones) {
    if (!on_ground(drone.truth)) names.push_back(drone.name);
  }
  return names;
}

bool RunResult::all_held() const {
  return std::all_of(verdicts.begin(), verdicts.end(), [](const Verdict& v) { return v.held; });
}

RunRecorder::RunRecorder(const Script& script, std::uint64_t seed, const std::vector<DroneObservation>& drones)
    : checker_(script.must, limits_of(script, drones)), metrics_(limits_of(script, drones)) {
  result_.script = script.name;
  result_.title = script.title;
  result_.seed = seed;
  for (const DroneObservation& drone : drones) result_.drones.push_back(drone.name);
  result_.timeline.resize(drones.size());
}

void RunRecorder::observe(const Moment& moment) {
  checker_.observe(moment);
  metrics_.observe(moment);
  for (const WorldEvent& event : moment.events) store_event(moment, event);
  if (moment.now < next_point_ns_) return;
  next_point_ns_ = moment.now + timeline_period_ns;
  for (std::size_t i = 0; i < moment.drones.size(); ++i)
    result_.timeline[i].push_back(point_of(moment.now, moment.drones[i]));
}

void RunRecorder::store_event(const Moment& moment, const WorldEvent& event) {
  const bool of_each_plan = event.kind == WorldEvent::Kind::applied || event.kind == WorldEvent::Kind::handed;
  if (of_each_plan || result_.events.size() >= max_events) return;
  result_.events.push_back(event);
  if (event.kind != WorldEvent::Kind::mode || !event.text.empty()) return;
  const DroneObservation& observation = moment.drones[event.drone];
  result_.events.back().text = mode_text(observation);
}

std::string mode_text(const DroneObservation& observation) {
  std::string text(name(observation.phase));
  if (observation.mode != FailsafeMode::none) text += fmt::format(", {}", name(observation.mode));
  if (observation.cause != FailsafeCause::none) text += fmt::format(" ({})", name(observation.cause));
  return text;
}

RunResult RunRecorder::finish(const Ending& ending) {
  result_.verdicts = checker_.finish(ending);
  result_.flown_ns = ending.now;
  result_.over = ending.over;
  result_.ok = ending.ok;
  result_.why = ending.why;
  result_.metrics = metrics_.finish(ending.now);
  return std::move(result_);
}

namespace {

// What agent and link counted: each of its last life, agent's the mean of the drones that it has a metric of.
void add_counts(const SimulatedWorld& world, Metrics& metrics) {
  Quantiles two_way;
  for (std::size_t i = 0; i < world.drones().size(); ++i) {
    const Quantiles drone = world.two_way_ms(i);
    if (drone.count == 0) continue;
    ++two_way.count;
    two_way.median += drone.median;
    two_way.p95 += drone.p95;
  }
  if (two_way.count > 0) {
    metrics.push_back({"two_way_median_ms", two_way.median / static_cast<double>(two_way.count)});
    metrics.push_back({"two_way_p95_ms", two_way.p95 / static_cast<double>(two_way.count)});
  }
  std::uint64_t received = 0, late = 0, dropped = 0;
  for (const link::DroneReport& drone : world.link() ? world.link()->reports() : std::vector<link::DroneReport>{}) {
    received += drone.plans.received;
    late += drone.plans.late;
    dropped += drone.plans.dropped;
  }
  if (received > 0) {
    metrics.push_back({"late_percent", 100 * static_cast<double>(late) / static_cast<double>(received)});
    metrics.push_back({"dropped_percent", 100 * static_cast<double>(dropped) / static_cast<double>(received)});
  }
  metrics.push_back({"transactions", static_cast<double>(world.transactions())});
}

}  // namespace

Result<RunResult> run_script(const Script& script, std::uint64_t seed) {
  if (const Status flown = check_sitl(script); !flown) return flown.error();
  WorldConfig config = script.flight;
  config.supervisors = std::any_of(script.faults.begin(), script.faults.end(),
                                   [](const Fault& fault) { return fault.acts.needs_supervisors; });
  config.seed = seed;
  auto made = SimulatedWorld::create(config);
  if (!made) return made.error();
  SimulatedWorld& world = **made;
  auto scheduled = FaultSchedule::create(script.faults, world.drones());
  if (!scheduled) return scheduled.error();
  FaultSchedule& schedule = *scheduled;
  Pilot pilot(script.pilot, script.flight, world.drones());

  RunRecorder recorder(script, seed, world.drones());
  std::vector<Moment::Excuse> excuses(world.drones().size());
  const auto over = [&] { return world.over() && !schedule.restart_pending(); };
  while (!over() && world.now() < script.limit_ns) {
    schedule.step(world);
    pilot.step(world);
    world.step();
    for (std::size_t i = 0; i < excuses.size(); ++i) {
      excuses[i] = schedule.excuse_of(i, world.now());
      excuses[i].physical = excuses[i].physical || world.drones()[i].truth.battery <= 0;
      excuses[i].steered = excuses[i].blind && link::uses_mocap(script.flight.pose);
    }
    recorder.observe({.now = world.now(),
                      .drones = world.drones(),
                      .events = world.events(),
                      .link_runs = world.runs(Process::link),
                      .excuses = excuses,
                      .first_fault_ns = schedule.first_begun_ns(),
                      .last_fault_end_ns = schedule.last_ended_ns(),
                      .first_fault_drones = schedule.first_drones()});
  }

  std::vector<std::string> plans;
  for (std::size_t i = 0; i < world.drones().size(); ++i) plans.push_back(plans_text(world, i));
  Metrics counts;
  add_counts(world, counts);
  Ending ending;
  ending.now = world.now();
  ending.over = over();
  ending.missing = schedule.never_begun();
  for (std::string& text : pilot.never_said()) ending.missing.push_back(std::move(text));
  ending.ok = world.ok();
  ending.why = world.why();
  ending.transactions = world.transactions();
  ending.in_the_air = in_the_air(world.drones());
  // With both processes alive and the ledger reached, nothing may be left behind.
  if (ending.over && world.runs(Process::agent) && world.runs(Process::link) && !schedule.any_active()) {
    for (int i = 0; i < 3'000 && world.transitions_pending() > 0; ++i) world.step();
    if (const auto pending = world.transitions_pending(); pending > 0)
      ending.lost.push_back(fmt::format("{} transitions never got onto the ledger", pending));
  }
  for (std::string& lost : world.lost_acknowledged()) ending.lost.push_back(std::move(lost));
  for (std::string& gap : world.lost_transitions()) ending.lost.push_back(std::move(gap));
  RunResult result = recorder.finish(ending);
  result.plans = std::move(plans);
  result.metrics.insert(result.metrics.end(), counts.begin(), counts.end());
  result.blocks = world.blocks();
  result.transactions = world.transactions();
  result.digest = world.digest();
  return result;
}

void fly_all(std::size_t count, unsigned jobs, const std::function<Flight(std::size_t)>& make,
             const std::function<bool(std::size_t, const Flight&, Result<RunResult>)>& done) {
  std::mutex mutex;
  std::size_t next = 0;
  const auto work = [&] {
    std::unique_lock lock(mutex);
    while (next < count) {
      const std::size_t mine = next++;
      const Flight flight = make(mine);
      lock.unlock();
      Result<RunResult> result = run_script(flight.script, flight.seed);
      lock.lock();
      if (!done(mine, flight, std::move(result))) next = count;
    }
  };
  std::vector<std::jthread> threads;
  for (unsigned i = 1; i < jobs; ++i) threads.emplace_back(work);
  work();
}

Result<std::pair<std::uint64_t, std::uint64_t>> parse_seeds(const std::string& text) {
  const auto number = [](const std::string& digits) -> std::uint64_t {
    if (digits.empty() || digits.size() > 18 || digits.find_first_not_of("0123456789") != std::string::npos) return 0;
    return std::stoull(digits);
  };
  const auto dots = text.find("..");
  const std::uint64_t first = number(text.substr(0, dots));
  const std::uint64_t last = dots == std::string::npos ? first : number(text.substr(dots + 2));
  if (first == 0 || last < first)
    return Error{fmt::format("\"{}\": seeds must be a number from 1 on, or two with .. between, as in 1..1000", text)};
  return std::pair(first, last);
}

std::vector<Flight> flights_of(const std::vector<Script>& scripts,
                               const std::optional<std::pair<std::uint64_t, std::uint64_t>>& seeds) {
  std::vector<Flight> flights;
  for (const Script& script : scripts) {
    const std::uint64_t own = script.seed.value_or(1);
    const auto [first, last] = seeds.value_or(std::pair(own, own));
    for (std::uint64_t seed = first; seed <= last; ++seed) flights.push_back({script, seed});
  }
  return flights;
}

}  // namespace ledgerline::hil
