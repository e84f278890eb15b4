#include "hil/fault/run/run.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "hil/fault/own/own_code.hpp"
#include "hil/fault/run/recorder.hpp"
#include "hil/fault/run/schedule.hpp"

namespace ledgerline::hil {
namespace {

// What agent and link counted: each of its last life, agent's the mean of the drones that it has a figure of.
void add_counts(const SimulatedWorld& world, Figures& figures) {
  Quantiles two_way;
  for (std::size_t i = 0; i < world.facts().size(); ++i) {
    const Quantiles drone = world.two_way_ms(i);
    if (drone.count == 0) continue;
    ++two_way.count;
    two_way.median += drone.median;
    two_way.p95 += drone.p95;
  }
  if (two_way.count > 0) {
    figures.push_back({"two_way_median_ms", two_way.median / static_cast<double>(two_way.count)});
    figures.push_back({"two_way_p95_ms", two_way.p95 / static_cast<double>(two_way.count)});
  }
  std::uint64_t received = 0, late = 0, dropped = 0;
  for (const link::DroneReport& drone : world.link() ? world.link()->reports() : std::vector<link::DroneReport>{}) {
    received += drone.plans.received;
    late += drone.plans.late;
    dropped += drone.plans.dropped;
  }
  if (received > 0) {
    figures.push_back({"late_percent", 100 * static_cast<double>(late) / static_cast<double>(received)});
    figures.push_back({"dropped_percent", 100 * static_cast<double>(dropped) / static_cast<double>(received)});
  }
  figures.push_back({"transactions", static_cast<double>(world.transactions())});
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
  auto scheduled = FaultSchedule::create(script.faults, world.facts());
  if (!scheduled) return scheduled.error();
  FaultSchedule& schedule = *scheduled;
  Pilot pilot(script.pilot, world.facts());

  RunRecorder recorder(script, seed, world.facts());
  std::vector<Moment::Excuse> excuses(world.facts().size());
  const auto over = [&] { return world.over() && !schedule.restart_pending(); };
  while (!over() && world.now() < script.limit_ns) {
    schedule.step(world);
    pilot.step(world);
    world.step();
    for (std::size_t i = 0; i < excuses.size(); ++i) {
      const FaultSchedule::Effect effect = schedule.effect_on(i, world.now());
      excuses[i] = {.physical = effect.pushed || world.facts()[i].truth.battery <= 0,
                    .broken = effect.broken,
                    .cut = effect.cut,
                    .blind = effect.blinded,
                    .misled = effect.misled,
                    .steered = effect.blinded && link::uses_mocap(script.flight.pose),
                    .spins = effect.broken,
                    .deaf = effect.deafened};
    }
    recorder.observe({.now = world.now(),
                      .drones = world.facts(),
                      .events = world.events(),
                      .link_runs = world.runs(Process::link),
                      .excuses = excuses,
                      .first_fault_ns = schedule.first_begun_ns(),
                      .last_fault_end_ns = schedule.last_ended_ns(),
                      .first_fault_drones = schedule.first_drones()});
  }

  std::vector<std::string> plans;
  for (std::size_t i = 0; i < world.facts().size(); ++i) plans.push_back(world.plans_text(i));
  Figures counts;
  add_counts(world, counts);
  Ending ending;
  ending.now = world.now();
  ending.over = over();
  ending.missing = schedule.never_begun();
  for (std::string& text : pilot.never_said()) ending.missing.push_back(std::move(text));
  ending.ok = world.ok();
  ending.why = world.why();
  ending.transactions = world.transactions();
  ending.in_the_air = in_the_air(world.facts());
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
  result.figures.insert(result.figures.end(), counts.begin(), counts.end());
  result.blocks = world.blocks();
  result.transactions = world.transactions();
  result.digest = world.digest();
  return result;
}

}  // namespace ledgerline::hil
