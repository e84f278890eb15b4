#include "common/verification/calls.hpp"

#include <algorithm>
#include <array>

#include "common/fabric/tx/policy.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "common/verification/control_events.hpp"

namespace ledgerline::verification {
namespace {

template <typename Message>
bool read(std::string_view bytes, Message& call) {
  return parse_message(bytes, call).ok();
}

/// In JSON one asset stands for a call of one.
bool read(std::string_view bytes, SetCall& call) {
  if (is_json(bytes)) {
    Asset single;
    if (parse_message(bytes, single)) {
      call.Clear();
      *call.add_assets() = std::move(single);
      return true;
    }
  }
  return parse_message(bytes, call).ok();
}

template <typename Message>
void complete(Message&) {}

/// The contract writes down the topic that a call may leave out.
void complete(SetCall& call) {
  for (Asset& asset : *call.mutable_assets()) {
    if (asset.topic().empty()) asset.set_topic("/" + asset.id());
  }
}

/// No message of ours has a map, so equal messages have equal bytes.
template <typename Message>
bool equal(const Message& a, const Message& b) {
  return a.ByteSizeLong() == b.ByteSizeLong() && a.SerializeAsString() == b.SerializeAsString();
}

template <typename Message>
Match match(std::string_view asked_bytes, std::string_view event_payload, Message& asked) {
  if (!read(asked_bytes, asked)) {
    asked.Clear();
    return asked_bytes == event_payload ? Match::malformed : Match::altered;
  }
  if (asked_bytes == event_payload) return Match::same;
  Message reported;
  if (!read(event_payload, reported)) return Match::altered;
  complete(asked);
  complete(reported);
  return equal(asked, reported) ? Match::same : Match::altered;
}

template <typename Message>
Match match(const RequestedCall& call, std::string_view function, std::string_view event_payload, Message& asked) {
  asked.Clear();
  if (call.function != function || call.args.size() != 1) return Match::altered;
  return match(call.args[0], event_payload, asked);
}

Match match_delete(const RequestedCall& call, std::string_view event_payload) {
  DeleteCall asked;
  if (call.args.size() != 1) return Match::altered;
  const std::string& arg = call.args[0];
  if (match(arg, event_payload, asked) == Match::same) return Match::same;
  DeleteCall reported;  // a plain id
  return read(event_payload, reported) && reported.id() == arg ? Match::same : Match::altered;
}

}  // namespace

Match match_command(const RequestedCall& call, std::string_view event_payload, CommandCall& asked) {
  return match(call, contract::command, event_payload, asked);
}

Match match_set(const RequestedCall& call, std::string_view event_payload, SetCall& asked) {
  if (!event_payload.empty() || call.args.size() != 1) return match(call, contract::set, event_payload, asked);
  // The event of a stream's call names it alone.
  const Match found = match(call, contract::set, call.args[0], asked);
  return found == Match::same && !asked.stream() ? Match::altered : found;
}

bool reports_set(const RequestedCall& call, std::string_view event_payload) {
  if (call.function == contract::set && call.args.size() == 1 && call.args[0] == event_payload) return true;
  SetCall asked;
  return match_set(call, event_payload, asked) == Match::same;
}

Plan plan_of(DroneNumber drone, const DronePlan& asked) {
  Plan plan;
  plan.drone = drone;
  plan.action = static_cast<PlanAction>(asked.action());
  plan.sequence = asked.sequence();
  plan.epoch = asked.epoch();
  plan.state_stamp_ns = asked.state_stamp_ns();
  plan.body_frame = asked.body_frame();
  if (const LearnedResponse& r = asked.response(); asked.has_response())
    plan.response = {r.gain(), r.lag_s(), r.dead_s()};
  plan.count = static_cast<std::uint32_t>(asked.setpoints_size());
  for (int i = 0; i < asked.setpoints_size(); ++i) {
    const PlannedSetpoint& s = asked.setpoints(i);
    Setpoint& setpoint = plan.setpoints[static_cast<std::size_t>(i)];
    setpoint = {.at_ns = s.at_ns(), .velocity_mps = {s.vx(), s.vy(), s.vz()}, .yaw_rate_radps = s.yaw_rate()};
    setpoint.has_reference = s.has_reference();
    const PlannedReference& r = s.reference();
    if (setpoint.has_reference)
      setpoint.reference = {{r.x(), r.y(), r.z()}, {r.vx(), r.vy(), r.vz()}, {r.ax(), r.ay(), r.az()}};
  }
  return plan;
}

Status check_event(const RequestedCall& call, std::string_view event_name, std::string_view event_payload) {
  const Error another{"its event is not the call"};
  if (call.function == contract::get || call.function == contract::history || call.function == contract::verify) {
    return event_name.empty() ? Status(done) : Error{"a question has no event"};
  }
  const bool is_call = call.function == contract::command || call.function == contract::set ||
                       call.function == contract::delete_ || call.function == contract::anchor;
  if (is_control_event(call.function)) {
    const auto event = read_control_event(call, event_name, event_payload);
    return event ? Status(done) : event.error();
  }
  if (!is_call) return done;
  if (event_name != call.function) return another;
  if (call.function == contract::set) return reports_set(call, event_payload) ? Status(done) : another;
  if (call.function == contract::anchor) {
    AnchorCall anchored;
    return match(call, contract::anchor, event_payload, anchored) == Match::same ? Status(done) : another;
  }
  CommandCall asked;
  const Match match = call.function == contract::command ? match_command(call, event_payload, asked)
                                                         : match_delete(call, event_payload);
  return match == Match::same ? Status(done) : another;
}

fabric::EndorsementNeed command_need(const std::string& organisation) {
  return {fabric::EndorsementNeed::Count::one, organisation};
}

fabric::EndorsementNeed batch_need() { return {fabric::EndorsementNeed::Count::one}; }

fabric::EndorsementNeed endorsement_need(std::string_view function) {
  using Count = fabric::EndorsementNeed::Count;
  if (function == contract::set) return {Count::two};
  // What changes records that are there needs their owner's peer alone: a second one must not hold it up.
  const bool makes_records = function == contract::enroll || function == contract::acquire ||
                             function == contract::hand_over || function == contract::anchor ||
                             function == contract::delete_;
  return {makes_records ? Count::two : Count::two_if_there_are, {}, function == contract::delete_};
}

bool is_of_hot_path(std::string_view key) { return key.starts_with("frame/") || key.starts_with("command/"); }

std::optional<std::string> likely_policy(std::string_view key) {
  constexpr std::array<std::string_view, 5> kinds{"command/", "lease/", "pilot/", "drones/",
                                                  "role/"};  // docs/ledger.md
  const auto kind =
      std::find_if(kinds.begin(), kinds.end(), [&](std::string_view one) { return key.starts_with(one); });
  if (kind == kinds.end()) return std::nullopt;
  key.remove_prefix(kind->size());
  if (*kind == "role/" && key.find('/') == std::string_view::npos) return std::nullopt;  // of the version before
  return fabric::peer_policy(std::string(key.substr(0, key.find('/'))));
}

}  // namespace ledgerline::verification
