#include "tools/audit/story/story.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/access/identity.hpp"
#include "common/base/text.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/ros.hpp"
#include "common/msg/stops.hpp"
#include "common/verification/calls.hpp"
#include "peer/transaction.pb.h"

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

constexpr std::size_t max_name = 200;   // of what others chose
constexpr std::size_t max_asked = 512;  // commands that no state has named yet: 10 s at 50 Hz
constexpr std::size_t max_functions = 200;

Moment moment_of(const ValidationResult& result, const fabric::Transaction& tx) {
  return {result.block, tx.timestamp_ns, printable(tx.tx_id, max_name)};
}

/// In `map`, or nullptr where it would outgrow its bound.
template <typename Map>
typename Map::mapped_type* bounded_entry(Map& map, const typename Map::key_type& key, std::size_t max) {
  const auto found = map.find(key);
  if (found != map.end()) return &found->second;
  return map.size() < max ? &map[key] : nullptr;
}

std::string action_word(Action action) { return action == TAKEOFF ? "take-off" : "landing"; }

/// Who signed a command; where it did so in a holder's place, for whom.
std::string commander_words(const crypto::IdentityName& signer, const DronePlan& plan,
                            const std::optional<Control>& record) {
  const std::string who = words_of(signer);
  const bool delegate =
      record && record->has_delegate() && to_name(record->delegate()) == signer && record->epoch() == plan.epoch();
  return delegate ? who + " for " + words_of(to_name(record->holder())) : who;
}

}  // namespace

void take_asset(const Asset& asset, const Moment& when, DroneStory& story) {
  if (asset.id().ends_with("/odom") && asset.msg_type() == odometry_type) take_pose(asset, story);
  if (asset.id().ends_with("/link") && asset.msg_type() == link_status_type) take_link(asset, story);
  if (asset.id().ends_with("/alarm") && asset.msg_type() == alarms_type) take_alarms(asset, when, story);
  if (asset.id().ends_with("/failsafe") && asset.msg_type() == transitions_type) take_transitions(asset, when, story);
}

std::string words_of(const crypto::IdentityName& name) {
  std::string subject = name.subject;
  if (subject.starts_with("CN=")) subject = subject.substr(3, subject.find(',') - 3);
  return printable(name.msp_id.empty() ? subject : name.msp_id + "/" + subject, max_name);
}

DroneStory* Story::drone(const std::string& name) {
  return bounded_entry(drones_, printable(name, max_name), max_drones);
}

Status Story::take(const ValidationResult& result, const fabric::Transaction& tx, const access::Caller& creator) {
  const std::string who = words_of(creator.name);
  const bool valid = result.code == protos::VALID;
  if (valid && tx.timestamp_ns > 0) {
    first_ns_ = first_ns_ == 0 ? tx.timestamp_ns : std::min(first_ns_, tx.timestamp_ns);
    last_ns_ = std::max(last_ns_, tx.timestamp_ns);
  }
  const bool ours = tx.contract == contract_;
  if (!valid) take_refusal(result, tx, who);
  if (valid) {
    const std::string name =
        printable(ours ? std::string(contract::current_name(tx.function)) : tx.contract + ":", max_name);
    if (auto* count = bounded_entry(functions_, name, max_functions)) ++*count;
  }
  if (!ours || !tx.problem.empty()) return done;
  if (tx.function == contract::command) take_command(result, tx, creator);
  if (!valid) return done;
  const Moment when = moment_of(result, tx);
  if (tx.function == contract::set) take_set(tx, when);
  if (verification::is_control_event(tx.event_name)) return take_control(tx, creator, when);
  return done;
}

void Story::take_refusal(const ValidationResult& result, const fabric::Transaction& tx, const std::string& who) {
  const bool ours = tx.contract == contract_;
  const std::string function(ours ? contract::current_name(tx.function) : std::string_view(tx.function));
  const RefusalKey key{result.code, who, printable(function, max_name)};
  Refusals* refusals = bounded_entry(refusals_, key, max_refusals);
  if (refusals == nullptr) {
    ++refusals_left_out_;
    return;
  }
  if (refusals->count++ == 0) {
    refusals->why = result.why;
    refusals->first = moment_of(result, tx);
  }
}

void Story::take_command(const ValidationResult& result, const fabric::Transaction& tx, const access::Caller& creator) {
  CommandCall call;
  if (tx.args.size() != 1 || !parse_message(tx.args[0], call)) return;
  const bool valid = result.code == protos::VALID;
  const Moment when = moment_of(result, tx);
  for (const DronePlan& plan : call.plans()) {
    // Of an invalid one only for drones that are there: anybody may name any.
    if (!valid && !drones_.contains(plan.drone())) continue;
    DroneStory* story = drone(plan.drone());
    if (story == nullptr) continue;
    const std::string who = commander_words(creator.name, plan, story->record);
    story->commands_over_time.add(tx.timestamp_ns, valid);
    if (Commands* commands = bounded_entry(story->commands, who, max_people)) {
      if (commands->first.tx_id.empty()) commands->first = when;
      commands->last = when;
      if (valid) {
        ++commands->valid;
      } else {
        ++commands->invalid[result.code];
      }
    }
    if (!valid) continue;
    if (plan.action() != FLY) {
      const Word* last = story->words.last();  // it is said again until it is done
      const std::string what = action_word(plan.action());
      if (last == nullptr || last->what != what || last->who != who) story->words.add({what, who, when});
    }
    if (plan.epoch() != story->asked_epoch || plan.boot_id() != story->asked_boot) {
      story->asked.clear();
      story->last_arrived = 0;
    }
    story->asked_epoch = plan.epoch();
    story->asked_boot = plan.boot_id();
    if (plan.state_stamp_ns() <= 0) continue;  // answers no state
    story->asked[plan.sequence()] = plan.state_stamp_ns();
    if (story->asked.size() > max_asked) story->asked.erase(story->asked.begin());
  }
}

void Story::take_set(const fabric::Transaction& tx, const Moment& when) {
  SetCall call;
  if (verification::match_set({tx.function, tx.args}, tx.event_payload, call) != verification::Match::same) return;
  for (const Asset& asset : call.assets()) {
    const auto slash = asset.id().find('/');
    if (slash == std::string::npos) continue;
    const auto found = drones_.find(asset.id().substr(0, slash));
    if (found == drones_.end()) continue;  // of no drone that was ever enrolled
    take_asset(asset, when, found->second);
  }
}

void Story::take_record(const Control& after, const std::string& by, const Moment& when) {
  DroneStory* story = drone(after.drone());
  if (story == nullptr) return;
  Tenure* last = story->holders.last();
  const bool held = last != nullptr && !last->to;
  const std::string holder = after.has_holder() ? words_of(to_name(after.holder())) : "";
  if (held && (holder != last->who || after.epoch() != last->epoch)) {
    last->to = when;
    last->ended_by = by;
  }
  const bool same = held && !last->to;
  const std::string delegate = after.has_delegate() ? words_of(to_name(after.delegate())) : "";
  if (after.has_holder() && !same)
    story->holders.add({holder, after.epoch(), after.priority(), when, std::nullopt, "", delegate});
  story->record = after;
}

Status Story::take_control(const fabric::Transaction& tx, const access::Caller& creator, const Moment& when) {
  const auto event = verification::read_control_event({tx.function, tx.args}, tx.event_name, tx.event_payload);
  if (!event) return event.error();
  const std::string who = words_of(creator.name), by = event->call.function + " by " + who;
  Status problem = done;
  const auto follows = [&](const std::string& drone_name, const Status& status) {
    if (!status && problem)
      problem = Error{fmt::format("{} of {} does not follow: {}", event->call.function, printable(drone_name, max_name),
                                  status.error().message)};
    return status.ok();
  };
  const auto role = verification::role_change(*event);
  const bool role_good = !role || follows("a role", verification::role_follows(*event, creator));
  for (const Control& after : event->controls.controls()) {
    DroneStory* story = drone(after.drone());
    if (story == nullptr) continue;
    // A drone's first record is what its enrolment makes of nothing.
    if (story->record && !follows(after.drone(), verification::control_follows(*event, *story->record, after, creator)))
      continue;
    if (tx.function != contract::acquire && tx.function != contract::release)
      story->words.add({event->call.function, who, when});
    take_record(after, by, when);
  }
  for (const Stop& stop : event->stops.stops()) {
    DroneStory* story = drone(stop.drone());
    if (story == nullptr) continue;
    if (story->record && !follows(stop.drone(), verification::stop_follows(*event, *story->record, stop, creator)))
      continue;
    story->words.add({stop.cut() ? "cut" : "stop", who, when});
    if (story->record) add_stop(*story->record, stop);
  }
  if (role && role_good) {
    const std::string of = words_of(to_name(role->identity));
    roles_.add({fmt::format("{} {}", Role_Name(role->role), of), who, when});
    for (auto& [name, story] : drones_) {
      if (story.record && names_identity(*story.record, role->identity))
        apply_role(*story.record, role->identity, role->role);
    }
  }
  return problem;
}

}  // namespace ledgerline::audit
