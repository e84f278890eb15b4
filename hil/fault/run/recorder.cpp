#include "hil/fault/run/recorder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/msg/names.hpp"
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

TimelinePoint point_of(TimeNs now, const DroneFacts& facts) {
  TimelinePoint point;
  point.t_ns = now;
  for (std::size_t i = 0; i < 3; ++i) {
    point.at_m[i] = static_cast<float>(facts.truth.position_m[i]);
    if (facts.pose) point.estimated_m[i] = static_cast<float>(facts.pose->position_m[i]);
  }
  point.sent_mps = static_cast<float>(facts.sent_mps);
  point.phase = facts.phase;
  point.mode = facts.mode;
  point.cause = facts.cause;
  point.lap = static_cast<std::uint8_t>(std::min(facts.lap, 255));
  return point;
}

}  // namespace

Limits limits_of(const Script& script, const std::vector<DroneFacts>& drones) {
  const double slack = 1.5 + misled_m(script), room = script.flight.room_m.value_or(3);
  Limits limits;
  limits.height_m += misled_m(script);
  limits.fence_min_m = {-std::abs(room), -std::abs(room), 0};
  limits.fence_max_m = {0, 0, 3};
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t k = 0; k < drones.size(); ++k) {
      const Reach reach = reach_of(task_of(script.flight, static_cast<int>(k) + 1));
      double &min_m = limits.fence_min_m[i], &max_m = limits.fence_max_m[i];
      min_m = std::min(min_m, drones[k].start_m[i] + reach.min_m[i] - std::abs(room));
      max_m = std::max(max_m, drones[k].start_m[i] + reach.max_m[i] + room);
    }
    limits.min_m[i] = limits.fence_min_m[i] - slack;
    limits.max_m[i] = limits.fence_max_m[i] + slack;
  }
  return limits;
}

std::vector<std::string> in_the_air(const std::vector<DroneFacts>& drones) {
  std::vector<std::string> names;
  for (const DroneFacts& drone : drones) {
    if (!on_ground(drone.truth)) names.push_back(drone.name);
  }
  return names;
}

bool RunResult::held() const {
  return std::all_of(verdicts.begin(), verdicts.end(), [](const Verdict& v) { return v.held; });
}

RunRecorder::RunRecorder(const Script& script, std::uint64_t seed, const std::vector<DroneFacts>& drones)
    : RunRecorder(script, seed, drones, limits_of(script, drones)) {}

RunRecorder::RunRecorder(const Script& script, std::uint64_t seed, const std::vector<DroneFacts>& drones,
                         const Limits& limits)
    : checker_(script.must, limits), figures_(limits) {
  result_.script = script.name;
  result_.title = script.title;
  result_.seed = seed;
  for (const DroneFacts& drone : drones) result_.drones.push_back(drone.name);
  result_.timeline.resize(drones.size());
  result_.fence_min_m = limits.min_m;
  result_.fence_max_m = limits.max_m;
}

void RunRecorder::observe(const Moment& moment) {
  checker_.observe(moment);
  figures_.observe(moment);
  for (const WorldEvent& event : moment.events) keep_event(moment, event);
  if (moment.now < next_point_ns_) return;
  next_point_ns_ = moment.now + timeline_period_ns;
  for (std::size_t i = 0; i < moment.drones.size(); ++i)
    result_.timeline[i].push_back(point_of(moment.now, moment.drones[i]));
}

void RunRecorder::keep_event(const Moment& moment, const WorldEvent& event) {
  const bool of_each_plan = event.kind == WorldEvent::Kind::applied || event.kind == WorldEvent::Kind::handed;
  if (of_each_plan || result_.events.size() >= max_events) return;
  result_.events.push_back(event);
  if (event.kind != WorldEvent::Kind::mode || !event.text.empty()) return;
  const DroneFacts& facts = moment.drones[event.drone];
  result_.events.back().text = mode_text(facts);
}

std::string mode_text(const DroneFacts& facts) {
  std::string text = name(facts.phase);
  if (facts.mode != FailsafeMode::none) text += fmt::format(", {}", name(facts.mode));
  if (facts.cause != FailsafeCause::none) text += fmt::format(" ({})", name(facts.cause));
  return text;
}

RunResult RunRecorder::finish(const Ending& ending) {
  result_.verdicts = checker_.finish(ending);
  result_.flown_ns = ending.now;
  result_.over = ending.over;
  result_.ok = ending.ok;
  result_.why = ending.why;
  result_.figures = figures_.finish(ending.now);
  return std::move(result_);
}

}  // namespace ledgerline::hil
