#include "tools/audit/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/access/access.hpp"
#include "common/access/grants.hpp"
#include "common/access/stops.hpp"
#include "common/base/text.hpp"
#include "common/base/utc.hpp"
#include "common/crypto/crypto.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/ros.hpp"
#include "common/verification/calls.hpp"
#include "peer/transaction.pb.h"

namespace ledgerline::audit {
namespace {

constexpr std::size_t max_alarm_kinds = 32;

void add_pose(const Asset& asset, DroneReport& report) {
  const auto odometry = odometry_from_cdr(asset.msg_data());
  if (!odometry) return;
  const auto& position = odometry->position_m;
  const bool finite = std::all_of(position.begin(), position.end(), [](double m) { return std::isfinite(m); });
  if (!finite || !report.is_in_span) return;
  for (std::size_t axis = 0; axis < position.size(); ++axis) {
    const bool first = report.path.count() == 0;
    report.lowest_m[axis] = first ? position[axis] : std::min(report.lowest_m[axis], position[axis]);
    report.highest_m[axis] = first ? position[axis] : std::max(report.highest_m[axis], position[axis]);
  }
  report.path.add({odometry->header.stamp_ns, position});
}

/// The newest command that was with link when the state was made, and when it came: both on the drone host's clock.
void add_link(const Asset& asset, DroneReport& report) {
  const auto state = state_from_cdr(asset.msg_data(), "");
  if (!state) return;
  const StateSample* sample = &state->sample;
  if (report.is_in_span) ++report.states;
  if (sample->boot_id != report.asked_boot || sample->arrived_sequence <= report.last_arrived) return;
  const auto asked = report.asked.find(sample->arrived_sequence);
  if (asked == report.asked.end()) return;
  report.last_arrived = sample->arrived_sequence;
  if (sample->arrived_ns > asked->second && report.is_in_span) report.two_way.add(sample->arrived_ns - asked->second);
  report.asked.erase(report.asked.begin(), std::next(asked));
}

void add_transitions(const Asset& asset, const Moment& when, DroneReport& report) {
  const auto transitions = transitions_from_cdr(asset.msg_data());
  if (!transitions) return;
  for (const Transition& transition : *transitions) {
    if (transition.boot_id != report.transition_boot) {
      report.transition_boot = transition.boot_id;
      report.last_transition = 0;
    }
    if (transition.number <= report.last_transition) continue;  // said again
    const std::uint64_t missing = transition.number - report.last_transition - 1;
    report.last_transition = transition.number;
    if (!report.is_in_span) continue;
    report.transitions_missing += missing;
    report.transitions.add({transition, when});
  }
}

/// Of a kind each time that it begins, counts more or is over: agent says the newest reason alone.
void add_alarms(const Asset& asset, const Moment& when, DroneReport& report) {
  const auto alarms = alarms_from_cdr(asset.msg_data());
  if (!alarms) return;
  for (const Alarm& alarm : *alarms) {
    if (!report.alarms.contains(alarm.kind) && report.alarms.size() == max_alarm_kinds) continue;
    DroneReport::Alarmed& before = report.alarms[alarm.kind];
    const DroneReport::Alarmed now{alarm.stands, alarm.count};
    if (now == before || (!alarm.stands && !before.stands)) continue;
    before = now;
    if (!report.is_in_span) continue;
    const std::string what = alarm.stands ? fmt::format("alarm, {}, {} so far: {}", printable(alarm.kind), alarm.count,
                                                        printable(alarm.words))
                                          : fmt::format("alarm, {}: over", printable(alarm.kind));
    report.events.add({what, "its host's agent", when});
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

/// Of an anchor before: a mission's approval that its words have not ended yet, or what withdraws one.
bool stands_at(const std::string& words, TimeNs from_ns) {
  if (!words.starts_with("mission ")) return false;
  if (words.find(" may not be flown any more at ") != std::string::npos) return true;
  const std::string until = " may be flown until ";
  const auto at = words.find(until);
  if (at == std::string::npos) return false;
  const auto begin = at + until.size();
  const auto end_s = parse_time_s(words.substr(begin, words.find(' ', begin) - begin));
  return end_s && *end_s * ns_per_s >= from_ns;
}

std::string action_text(Action action) { return action == TAKEOFF ? "take-off" : "landing"; }

/// Whom a control function is about, beside the drone.
std::string object_text(const access::CallMessage& message) {
  const auto named = [](const Identity& identity) {
    return identity.subject().empty() ? printable(identity.msp_id(), max_name) : text_of(to_name(identity));
  };
  if (const auto* enrolled = std::get_if<EnrollCall>(&message)) return "on host " + named(enrolled->identity());
  if (const auto* granted = std::get_if<GrantCall>(&message))
    return fmt::format("to {}: {}", named(granted->grant().to()), rights_text(granted->grant()));
  if (const auto* answered = std::get_if<AnswerCall>(&message)) return "to " + named(answered->to());
  return "";
}

/// Who signed a command; where it did so in a holder's place, under whose lease.
std::string commander_text(const crypto::IdentityName& signer, const DronePlan& plan,
                           const std::optional<Control>& record) {
  const std::string who = text_of(signer);
  const bool delegate =
      record && record->has_delegate() && to_name(record->delegate()) == signer && record->epoch() == plan.epoch();
  return delegate ? fmt::format("{} under {}'s lease", who, text_of(to_name(record->holder()))) : who;
}

}  // namespace

void add_asset(const Asset& asset, const Moment& when, DroneReport& report) {
  if (asset.id().ends_with("/odom") && asset.msg_type() == odometry_type) add_pose(asset, report);
  if (asset.id().ends_with("/link") && asset.msg_type() == link_status_type) add_link(asset, report);
  if (asset.id().ends_with("/alarm") && asset.msg_type() == alarms_type) add_alarms(asset, when, report);
  if (asset.id().ends_with("/failsafe") && asset.msg_type() == transitions_type) add_transitions(asset, when, report);
}

std::string text_of(const crypto::IdentityName& name) {
  std::string subject = name.subject;
  if (subject.starts_with("CN=")) subject = subject.substr(3, subject.find(',') - 3);
  return printable(name.msp_id.empty() ? subject : name.msp_id + "/" + subject, max_name);
}

DroneReport* ChainReport::drone(const std::string& name) {
  DroneReport* report = bounded_entry(drones_, printable(name, max_name), max_drones);
  if (report != nullptr) report->is_in_span = is_in_span_;
  return report;
}

Status ChainReport::add(const ValidationResult& result, const fabric::Transaction& tx, const access::Caller& creator) {
  const std::string who = text_of(creator.name);
  const bool valid = result.code == protos::VALID;
  is_in_span_ = span_.contains(tx.timestamp_ns);
  if (valid && is_in_span_ && tx.timestamp_ns > 0) {
    first_ns_ = first_ns_ == 0 ? tx.timestamp_ns : std::min(first_ns_, tx.timestamp_ns);
    last_ns_ = std::max(last_ns_, tx.timestamp_ns);
  }
  const bool ours = tx.contract == contract_;
  if (!valid && is_in_span_) add_refusal(result, tx, who);
  if (valid && is_in_span_) {
    const std::string name =
        printable(ours ? std::string(contract::current_name(tx.function)) : tx.contract + ":", max_name);
    if (auto* count = bounded_entry(functions_, name, max_functions)) ++*count;
  }
  if (!ours || !tx.problem.empty()) return done;
  if (tx.function == contract::command) add_command(result, tx, creator);
  if (!valid) return done;
  const Moment when = moment_of(result, tx);
  if (tx.function == contract::set) add_set(tx, when);
  if (tx.function == contract::anchor) add_anchor(tx, who, when);
  if (verification::is_control_event(tx.event_name)) return add_control(tx, creator, when);
  return done;
}

void ChainReport::add_refusal(const ValidationResult& result, const fabric::Transaction& tx, const std::string& who) {
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

void ChainReport::add_command(const ValidationResult& result, const fabric::Transaction& tx,
                              const access::Caller& creator) {
  CommandCall call;
  if (tx.args.size() != 1 || !parse_message(tx.args[0], call)) return;
  const bool valid = result.code == protos::VALID;
  const Moment when = moment_of(result, tx);
  for (const DronePlan& plan : call.plans()) {
    // Of an invalid one only for drones that are there: anybody may name any.
    if (!valid && !drones_.contains(plan.drone())) continue;
    DroneReport* report = drone(plan.drone());
    if (report == nullptr) continue;
    const std::string who = commander_text(creator.name, plan, report->record);
    if (is_in_span_) report->commands_over_time.add(tx.timestamp_ns, valid);
    if (Commands* commands = is_in_span_ ? bounded_entry(report->commands, who, max_people) : nullptr) {
      if (commands->first.tx_id.empty()) commands->first = when;
      commands->last = when;
      if (valid) {
        ++commands->valid;
      } else {
        ++commands->invalid[result.code];
      }
    }
    if (!valid) continue;
    if (plan.action() != FLY && is_in_span_) {
      const Event* last = report->events.last();  // it is said again until it is done
      const std::string what = action_text(plan.action());
      if (last == nullptr || last->what != what || last->who != who) report->events.add({what, who, when});
    }
    if (plan.epoch() != report->asked_epoch || plan.boot_id() != report->asked_boot) {
      report->asked.clear();
      report->last_arrived = 0;
    }
    report->asked_epoch = plan.epoch();
    report->asked_boot = plan.boot_id();
    if (plan.state_stamp_ns() <= 0) continue;  // answers no state
    report->asked[plan.sequence()] = plan.state_stamp_ns();
    if (report->asked.size() > max_asked) report->asked.erase(report->asked.begin());
  }
}

void ChainReport::add_set(const fabric::Transaction& tx, const Moment& when) {
  SetCall call;
  if (verification::match_set({tx.function, tx.args}, tx.event_payload, call) != verification::Match::same) return;
  for (const Asset& asset : call.assets()) {
    const auto slash = asset.id().find('/');
    if (slash == std::string::npos) continue;
    const auto found = drones_.find(asset.id().substr(0, slash));
    if (found == drones_.end()) continue;  // of no drone that was ever enrolled
    found->second.is_in_span = is_in_span_;
    add_asset(asset, when, found->second);
  }
}

void ChainReport::add_anchor(const fabric::Transaction& tx, const std::string& who, const Moment& when) {
  AnchorCall call;
  if (tx.args.size() != 1 || !parse_message(tx.args[0], call)) return;
  if (!is_in_span_ && (when.time_ns > span_.to_ns || !stands_at(call.what(), span_.from_ns))) return;
  anchors_.add(
      {fmt::format("\"{}\", SHA-256 {}", printable(call.what(), max_name), crypto::hex(call.digest())), who, when});
}

void ChainReport::add_record(const Control& after, const std::string& by, const Moment& when) {
  DroneReport* report = drone(after.drone());
  if (report == nullptr) return;
  Tenure* last = report->holders.last();
  const bool held = last != nullptr && !last->to;
  const std::string holder = after.has_holder() ? text_of(to_name(after.holder())) : "";
  if (held && (holder != last->who || after.epoch() != last->epoch)) {
    last->to = when;
    last->ended_by = by;
  }
  const bool same = held && !last->to;
  if (held && !same && when.time_ns < span_.from_ns) report->holders.drop_last();
  const std::string delegate = after.has_delegate() ? text_of(to_name(after.delegate())) : "";
  if (after.has_holder() && !same && when.time_ns <= span_.to_ns)
    report->holders.add({holder, after.epoch(), after.priority(), when, std::nullopt, "", delegate});
  report->record = after;
}

Status ChainReport::add_control(const fabric::Transaction& tx, const access::Caller& creator, const Moment& when) {
  const auto event = verification::read_control_event({tx.function, tx.args}, tx.event_name, tx.event_payload);
  if (!event) return event.error();
  const std::string who = text_of(creator.name), by = event->call.function + " by " + who;
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
    DroneReport* report = drone(after.drone());
    if (report == nullptr) continue;
    // A drone's first record is what its enrolment makes of nothing.
    if (report->record &&
        !follows(after.drone(), verification::control_follows(*event, *report->record, after, creator)))
      continue;
    if (tx.function != contract::acquire && tx.function != contract::release && is_in_span_)
      report->events.add({event->call.function, who, when, object_text(event->call.message)});
    add_record(after, by, when);
  }
  for (const Stop& stop : event->stops.stops()) {
    DroneReport* report = drone(stop.drone());
    if (report == nullptr) continue;
    if (report->record && !follows(stop.drone(), verification::stop_follows(*event, *report->record, stop, creator)))
      continue;
    if (is_in_span_) report->events.add({stop.cut() ? "cut" : "stop", who, when});
    if (report->record) add_stop(*report->record, stop);
  }
  if (role && role_good) {
    const std::string of = text_of(to_name(role->identity));
    if (is_in_span_) roles_.add({fmt::format("{} {}", Role_Name(role->role), of), who, when});
    for (auto& [name, report] : drones_) {
      if (report.record && names_identity(*report.record, role->identity))
        apply_role(*report.record, role->identity, role->role);
    }
  }
  return problem;
}

}  // namespace ledgerline::audit
