#include "tools/audit/story/states.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/printable.hpp"
#include "common/msg/ros.hpp"

namespace ledgerline::audit {
namespace {

constexpr std::size_t max_alarm_kinds = 32;

void take_pose(const Asset& asset, DroneStory& story) {
  const auto odometry = odometry_from_cdr(asset.msg_data());
  if (!odometry) return;
  const auto& position = odometry->position_m;
  const bool finite = std::all_of(position.begin(), position.end(), [](double m) { return std::isfinite(m); });
  if (!finite) return;
  for (std::size_t axis = 0; axis < position.size(); ++axis) {
    const bool first = story.path.seen() == 0;
    story.lowest_m[axis] = first ? position[axis] : std::min(story.lowest_m[axis], position[axis]);
    story.highest_m[axis] = first ? position[axis] : std::max(story.highest_m[axis], position[axis]);
  }
  story.path.add({odometry->header.stamp_ns, position});
}

/// The newest command that was with link when the state was made, and when it came: both on the drone host's clock.
void take_link(const Asset& asset, DroneStory& story) {
  const auto state = state_from_cdr(asset.msg_data(), "");
  if (!state) return;
  const StateSample* sample = &state->sample;
  ++story.states;
  if (sample->boot_id != story.asked_boot || sample->arrived_sequence <= story.last_arrived) return;
  const auto asked = story.asked.find(sample->arrived_sequence);
  if (asked == story.asked.end()) return;
  story.last_arrived = sample->arrived_sequence;
  if (sample->arrived_ns > asked->second) story.two_way.add(sample->arrived_ns - asked->second);
  story.asked.erase(story.asked.begin(), std::next(asked));
}

void take_transitions(const Asset& asset, const Moment& when, DroneStory& story) {
  const auto transitions = transitions_from_cdr(asset.msg_data());
  if (!transitions) return;
  for (const Transition& transition : *transitions) {
    if (transition.boot_id != story.transition_boot) {
      story.transition_boot = transition.boot_id;
      story.last_transition = 0;
    }
    if (transition.number <= story.last_transition) continue;  // said again
    story.transitions_missing += transition.number - story.last_transition - 1;
    story.last_transition = transition.number;
    story.transitions.add({transition, when});
  }
}

/// Of a kind each time that it begins, counts more or is over: agent says the newest reason alone.
void take_alarms(const Asset& asset, const Moment& when, DroneStory& story) {
  const auto alarms = alarms_from_cdr(asset.msg_data());
  if (!alarms) return;
  for (const Alarm& alarm : *alarms) {
    if (!story.alarms.contains(alarm.kind) && story.alarms.size() == max_alarm_kinds) continue;
    DroneStory::Alarmed& before = story.alarms[alarm.kind];
    const DroneStory::Alarmed now{alarm.stands, alarm.count};
    if (now == before || (!alarm.stands && !before.stands)) continue;
    before = now;
    const std::string what = alarm.stands ? fmt::format("alarm, {}, {} so far: {}", printable(alarm.kind), alarm.count,
                                                        printable(alarm.words))
                                          : fmt::format("alarm, {}: over", printable(alarm.kind));
    story.words.add({what, "its host's agent", when});
  }
}

}  // namespace

void take_asset(const Asset& asset, const Moment& when, DroneStory& story) {
  if (asset.id().ends_with("/odom") && asset.msg_type() == odometry_type) take_pose(asset, story);
  if (asset.id().ends_with("/link") && asset.msg_type() == link_status_type) take_link(asset, story);
  if (asset.id().ends_with("/alarm") && asset.msg_type() == alarms_type) take_alarms(asset, when, story);
  if (asset.id().ends_with("/failsafe") && asset.msg_type() == transitions_type) take_transitions(asset, when, story);
}

}  // namespace ledgerline::audit
