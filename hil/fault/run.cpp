#include "hil/fault/run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/msg/names.hpp"
#include "hil/fault/schedule.hpp"

namespace ledgerline::hil {
namespace {

using What = Fault::What;

// How far the fence may be off, since what link believes is off.
double misled_m(const std::vector<Fault>& faults) {
  double metres = 0;
  for (const Fault& fault : faults) {
    if (fault.what == What::mocap_offset) metres += std::hypot(fault.vector[0], fault.vector[1], fault.vector[2]);
    if (fault.what == What::mocap_noise) metres += 3 * fault.value;
  }
  return metres;
}

}  // namespace

Limits limits_of(const Script& script, const std::vector<DroneFacts>& drones) {
  const double slack = 1.5 + misled_m(script.faults), room = script.flight.room_m;
  Limits limits;
  limits.height_m += misled_m(script.faults);
  limits.fence_min_m = {-std::abs(room), -std::abs(room), 0};
  limits.fence_max_m = {0, 0, 3};
  for (std::size_t i = 0; i < 2; ++i) {
    for (const DroneFacts& drone : drones)
      limits.fence_max_m[i] = std::max(limits.fence_max_m[i], drone.start_m[i] + script.flight.side_m + room);
    limits.min_m[i] = limits.fence_min_m[i] - slack;
    limits.max_m[i] = limits.fence_max_m[i] + slack;
  }
  return limits;
}

TimelinePoint point_of(TimeNs now, const DroneFacts& facts) {
  TimelinePoint point;
  point.t_ns = now;
  for (std::size_t i = 0; i < 3; ++i) {
    point.at_m[i] = static_cast<float>(facts.truth.position_m[i]);
    if (facts.pose) point.believed_m[i] = static_cast<float>(facts.pose->position_m[i]);
  }
  point.told_mps = static_cast<float>(facts.told_mps);
  point.phase = facts.phase;
  point.mode = facts.mode;
  point.cause = facts.cause;
  point.lap = static_cast<std::uint8_t>(std::min(facts.lap, 255));
  return point;
}

bool RunResult::held() const {
  return std::all_of(verdicts.begin(), verdicts.end(), [](const Verdict& v) { return v.held; });
}

Result<RunResult> run_script(const Script& script, std::uint64_t seed) {
  WorldConfig config = script.flight;
  config.supervisors = std::any_of(script.faults.begin(), script.faults.end(),
                                   [](const Fault& fault) { return fault.stopper != Stopper::operating; });
  config.seed = seed;
  auto made = VirtualWorld::create(config);
  if (!made) return made.error();
  VirtualWorld& world = **made;
  auto scheduled = FaultSchedule::create(script.faults, world.facts());
  if (!scheduled) return scheduled.error();
  FaultSchedule& schedule = *scheduled;

  RunResult result;
  result.script = script.name;
  result.title = script.title;
  result.seed = seed;
  for (const DroneFacts& drone : world.facts()) result.drones.push_back(drone.name);
  result.timeline.resize(world.facts().size());
  const Limits limits = limits_of(script, world.facts());
  result.fence_min_m = limits.min_m;
  result.fence_max_m = limits.max_m;
  Judge judge(script.must, limits);

  std::vector<Moment::Excuse> excuses(world.facts().size());
  TimeNs next_point_ns = 0;
  const auto over = [&] { return world.over() && !schedule.restart_pending(); };
  while (!over() && world.now() < script.limit_ns) {
    schedule.step(world);
    world.step();
    for (std::size_t i = 0; i < excuses.size(); ++i) {
      const FaultSchedule::Effect effect = schedule.effect_on(i, world.now());
      excuses[i] = {effect.pushed || world.facts()[i].truth.battery <= 0, effect.deafened};
    }
    judge.look({.now = world.now(),
                .drones = world.facts(),
                .events = world.events(),
                .link_runs = world.runs(Process::link),
                .excuses = excuses,
                .first_fault_ns = schedule.first_begun_ns(),
                .last_fault_end_ns = schedule.last_ended_ns(),
                .first_fault_drones = schedule.first_drones()});
    for (const WorldEvent& event : world.events()) {
      if (event.kind == WorldEvent::Kind::applied || event.kind == WorldEvent::Kind::handed ||
          result.events.size() >= max_events)
        continue;
      result.events.push_back(event);
      if (event.kind == WorldEvent::Kind::mode) {
        const DroneFacts& facts = world.facts()[event.drone];
        result.events.back().text = fmt::format("{}, {} ({})", name(facts.phase), name(facts.mode), name(facts.cause));
      }
    }
    if (world.now() >= next_point_ns) {
      next_point_ns = world.now() + timeline_period_ns;
      for (std::size_t i = 0; i < world.facts().size(); ++i)
        result.timeline[i].push_back(point_of(world.now(), world.facts()[i]));
    }
  }

  for (std::size_t i = 0; i < world.facts().size(); ++i) result.plans.push_back(world.plans_text(i));
  Ending ending;
  ending.now = world.now();
  ending.over = over();
  ending.missing = schedule.never_begun();
  ending.ok = world.ok();
  ending.why = world.why();
  ending.transactions = world.transactions();
  for (const DroneFacts& drone : world.facts()) {
    if (!on_ground(drone.truth)) ending.in_the_air.push_back(drone.name);
  }
  // With both processes alive and the ledger reached, nothing may be left behind.
  if (ending.over && world.runs(Process::agent) && world.runs(Process::link) && !schedule.any_active()) {
    for (int i = 0; i < 3'000 && world.transitions_pending() > 0; ++i) world.step();
    if (const auto pending = world.transitions_pending(); pending > 0)
      ending.lost.push_back(fmt::format("{} transitions never got onto the ledger", pending));
  }
  for (std::string& lost : world.lost_acknowledged()) ending.lost.push_back(std::move(lost));
  for (std::string& gap : world.lost_transitions()) ending.lost.push_back(std::move(gap));
  result.verdicts = judge.finish(ending);
  result.flown_ns = ending.now;
  result.over = ending.over;
  result.ok = ending.ok;
  result.why = ending.why;
  result.blocks = world.blocks();
  result.transactions = world.transactions();
  result.digest = world.digest();
  return result;
}

}  // namespace ledgerline::hil
