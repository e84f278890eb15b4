#include "common/verification/control_events.hpp"

#include <algorithm>
#include <set>
#include <string>

#include "common/access/stops.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::verification {
namespace {

/// Calls of messages alone; the others may be plain strings.
template <typename Message>
constexpr bool has_plain_form = std::is_same_v<Message, LeaseCall> || std::is_same_v<Message, DronesCall>;

/// Plain strings: drones, and options as "key=value".
template <typename Message>
void read_plain(const std::vector<std::string>& args, Message& call) {
  for (const std::string& arg : args) {
    const auto equals = arg.find('=');
    if (equals == std::string::npos) {
      if (!arg.empty()) call.add_drones(arg);
      continue;
    }
    const std::string key = arg.substr(0, equals), value = arg.substr(equals + 1);
    if constexpr (std::is_same_v<Message, DronesCall>) {
      if (key == "cut" && value == "true") call.set_cut(true);
    } else {
      const bool number = !value.empty() && value.size() <= 9 &&
                          std::all_of(value.begin(), value.end(), [](char c) { return c >= '0' && c <= '9'; });
      if (key == "priority" && number) call.set_priority(static_cast<std::uint32_t>(std::stoul(value)));
    }
  }
}

template <typename Message>
bool read_call(const RequestedCall& call, Message& asked) {
  if (std::all_of(call.args.begin(), call.args.end(), [](const std::string& arg) { return is_plain(arg); })) {
    if constexpr (has_plain_form<Message>) read_plain(call.args, asked);
    return has_plain_form<Message>;
  }
  return call.args.size() == 1 && parse_message(call.args[0], asked);
}

std::set<std::string> drones_of(const RevokeCall&) { return {}; }
template <typename Message>
std::set<std::string> drones_of(const Message& asked) {
  return {asked.drones().begin(), asked.drones().end()};
}

template <typename List>
bool names_exactly(const List& entries, const std::set<std::string>& drones) {
  std::set<std::string> reported;
  for (const auto& entry : entries) reported.insert(entry.drone());
  return reported == drones && static_cast<std::size_t>(entries.size()) == drones.size();
}

/// A list beside the drones is empty or as long as they are: the contract refuses others.
bool fits_its_drones(const DronesCall& asked) {
  const auto fits = [&](int entries) { return entries == 0 || entries == asked.drones_size(); };
  return fits(asked.clears_size()) && fits(asked.epochs_size());
}
template <typename Message>
bool fits_its_drones(const Message&) {
  return true;
}

template <typename Message>
Result<ControlEvent> read_as(const RequestedCall& call, std::string_view event_payload) {
  ControlEvent event;
  Message asked;
  if (!read_call(call, asked)) return Error{"its call cannot be read"};
  if (!fits_its_drones(asked)) return Error{"it says something of each drone, but not of as many as it names"};
  const bool stops = call.function == contract::stop;
  const bool read =
      stops ? parse_message(event_payload, event.stops).ok() : parse_message(event_payload, event.controls).ok();
  if (!read) return Error{"its event cannot be read"};
  const auto drones = drones_of(asked);
  const bool exactly =
      stops ? names_exactly(event.stops.stops(), drones) : names_exactly(event.controls.controls(), drones);
  if (!exactly) return Error{"its event is of other drones than were asked for"};
  event.call = {std::string(contract::current_name(call.function)), std::move(asked)};
  const auto change = role_change(event);
  if (change && (event.controls.role() != change->role || !same_identity(event.controls.identity(), change->identity)))
    return Error{"its event is of another role than was asked for"};
  return event;
}

bool equal(const Control& a, const Control& b) { return a.SerializeAsString() == b.SerializeAsString(); }

Error not_following(const access::Refusal& why) {
  return Error{std::string(access::id_of(why.rule)) + ": " + why.text};
}

}  // namespace

bool is_control_event(std::string_view event_name) { return contract::is_control(contract::current_name(event_name)); }

Result<ControlEvent> read_control_event(const RequestedCall& call, std::string_view event_name,
                                        std::string_view event_payload) {
  if (!is_control_event(event_name)) return Error{"it is no control event"};
  if (call.function != event_name) return Error{"its event is of another function than was asked for"};
  if (call.function == contract::enroll) return read_as<EnrollCall>(call, event_payload);
  if (call.function == contract::revoke) return read_as<RevokeCall>(call, event_payload);
  if (call.function == contract::grant) return read_as<GrantCall>(call, event_payload);
  if (call.function == contract::hand_over || call.function == contract::deny)
    return read_as<AnswerCall>(call, event_payload);
  const bool lease =
      call.function == contract::acquire || call.function == contract::release || call.function == contract::request;
  return lease ? read_as<LeaseCall>(call, event_payload) : read_as<DronesCall>(call, event_payload);
}

Status control_follows(const ControlEvent& event, const Control& before, const Control& after,
                       const access::Caller& caller) {
  if (after.drone() != before.drone()) return Error{"its record is of another drone"};
  if (after.epoch() < before.epoch()) return Error{"its epoch goes back"};
  if (equal(before, after)) return done;
  if (event.call.function == contract::stop) return Error{"a stop changes no record"};
  access::RuleInputs inputs{.new_epoch = std::max(after.epoch(), before.epoch() + 1),
                            .moves_streams = after.former_owners_size() > before.former_owners_size()};
  Status refused = done;
  for (const Role role : {SUPERVISOR, OPERATOR}) {  // its role stays the peer's word
    inputs.roles.known = {{caller.name, role}};
    const auto becomes = access::apply(before, event.call, caller, inputs);
    if (const auto* why = std::get_if<access::Refusal>(&becomes)) {
      if (refused) refused = not_following(*why);
    } else if (equal(std::get<Control>(becomes), after)) {
      return done;
    }
  }
  return refused ? Error{"its record does not follow from the one before"} : refused;
}

std::optional<RoleChange> role_change(const ControlEvent& event) {
  if (const auto* revoked = std::get_if<RevokeCall>(&event.call.message))
    return RoleChange{revoked->identity(), REVOKED};
  const auto* enrolled = std::get_if<EnrollCall>(&event.call.message);
  if (!enrolled || enrolled->role() == ROLE_NONE) return std::nullopt;
  return RoleChange{enrolled->identity(), enrolled->role()};
}

Status role_follows(const ControlEvent& event, const access::Caller& caller) {
  const auto why = access::check_call(event.call, caller, {});
  return why ? Status(not_following(*why)) : Status(done);
}

Result<DronesCall> read_stop_call(const RequestedCall& call) {
  DronesCall asked;
  if (call.function != contract::stop || !read_call(call, asked)) return Error{"it is no call of stop"};
  return asked;
}

Stop signed_stop(const DronesCall& asked, std::string_view event_payload, const std::string& drone,
                 const Identity& creator) {
  Stop stop;
  stop.set_drone(drone);
  *stop.mutable_stopper() = creator;
  stop.set_cut(asked.cut());
  if (const auto clears = said_of(asked, asked.clears(), drone)) {
    stop.set_clears(*clears);
    return stop;
  }
  Stops reported;
  if (!parse_message(event_payload, reported)) return stop;
  for (const Stop& one : reported.stops()) {
    if (one.drone() == drone && same_identity(one.stopper(), creator)) stop.set_clears(one.clears());
  }
  return stop;
}

Status stop_follows(const ControlEvent& event, const Control& before, const Stop& stop, const access::Caller& caller) {
  if (event.call.function != contract::stop) return Error{"it is no stop"};
  const auto& asked = std::get<DronesCall>(event.call.message);
  if (to_name(stop.stopper()) != caller.name || stop.cleared()) return Error{"it is not its creator's own stop"};
  if (stop.cut() != asked.cut()) return Error{"its cut is not as it was asked for"};
  if (stop.cut()) {  // that its creator may stop it stays the peer's word
    if (const auto why = access::check_stop(before, caller, std::nullopt, true)) return not_following(*why);
  }
  if (const auto why = access::check_clears(asked, stop.drone(), caller, stop.clears())) return not_following(*why);
  return done;
}

}  // namespace ledgerline::verification
