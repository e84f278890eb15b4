#include "hil/fault/run/run.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "hil/fault/run/recorder.hpp"
#include "hil/fault/run/schedule.hpp"

namespace ledgerline::hil {

Result<RunResult> run_script(const Script& script, std::uint64_t seed) {
  WorldConfig config = script.flight;
  config.supervisors = std::any_of(script.faults.begin(), script.faults.end(),
                                   [](const Fault& fault) { return fault.acts.needs_supervisors; });
  config.seed = seed;
  auto made = VirtualWorld::create(config);
  if (!made) return made.error();
  VirtualWorld& world = **made;
  auto scheduled = FaultSchedule::create(script.faults, world.facts());
  if (!scheduled) return scheduled.error();
  FaultSchedule& schedule = *scheduled;

  RunRecorder recorder(script, seed, world.facts());
  std::vector<Moment::Excuse> excuses(world.facts().size());
  const auto over = [&] { return world.over() && !schedule.restart_pending(); };
  while (!over() && world.now() < script.limit_ns) {
    schedule.step(world);
    world.step();
    const bool own_senses = script.flight.pose != link::PoseSource::mocap;
    for (std::size_t i = 0; i < excuses.size(); ++i) {
      const FaultSchedule::Effect effect = schedule.effect_on(i, world.now());
      excuses[i] = {.physical = effect.pushed || world.facts()[i].truth.battery <= 0,
                    .broken = effect.broken,
                    .cut = effect.cut,
                    .blind = effect.blinded && own_senses,
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
  Ending ending;
  ending.now = world.now();
  ending.over = over();
  ending.missing = schedule.never_begun();
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
  result.blocks = world.blocks();
  result.transactions = world.transactions();
  result.digest = world.digest();
  return result;
}

}  // namespace ledgerline::hil
