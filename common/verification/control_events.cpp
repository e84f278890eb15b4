#include "common/verification/control_events.hpp"

#include <algorithm>
#include <array>
#include <set>
#include <string>

#include "common/msg/contract.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/requests.hpp"
#include "common/msg/stops.hpp"
#include "common/verification/identity.hpp"

namespace ledgerline::verification {
namespace {

bool same(const Identity& a, const crypto::IdentityName& b) {
  return a.msp_id() == b.msp_id && a.subject() == b.subject;
}

/// Calls of messages alone; the others may be plain strings.
template <typename Message>
constexpr bool has_plain_form = std::is_same_v<Message, LeaseCall> || std::is_same_v<Message, DronesCall>;

/// Plain strings: drones, and options as "key=value".
template <typename Message>
bool read_plain(const std::vector<std::string>& args, Message& call) {
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
  return true;
}

template <typename Message>
bool read_call(const RequestedCall& call, Message& asked) {
  if (std::all_of(call.args.begin(), call.args.end(), [](const std::string& arg) { return is_plain(arg); })) {
    if constexpr (has_plain_form<Message>) return read_plain(call.args, asked);
    return false;
  }
  return call.args.size() == 1 && parse_message(call.args[0], asked);
}

template <typename Message>
std::set<std::string> drones_of(const Message& asked) {
  if constexpr (std::is_same_v<Message, RevokeCall>)
    return {};
  else
    return {asked.drones().begin(), asked.drones().end()};
}

template <typename List>
bool names_exactly(const List& entries, const std::set<std::string>& drones) {
  std::set<std::string> reported;
  for (const auto& entry : entries) reported.insert(entry.drone());
  return reported == drones && static_cast<std::size_t>(entries.size()) == drones.size();
}

template <typename Message>
Result<ControlEvent> read_as(const RequestedCall& call, std::string_view event_payload) {
  ControlEvent event;
  event.function = contract::current_name(call.function);
  Message asked;
  if (!read_call(call, asked)) return Error{"its call cannot be read"};
  const bool stops = call.function == contract::stop;
  const bool read =
      stops ? parse_message(event_payload, event.stops).ok() : parse_message(event_payload, event.controls).ok();
  if (!read) return Error{"its event cannot be read"};
  const auto drones = drones_of(asked);
  const bool exactly =
      stops ? names_exactly(event.stops.stops(), drones) : names_exactly(event.controls.controls(), drones);
  if (!exactly) return Error{"its event is of other drones than were asked for"};
  event.asked = std::move(asked);
  const auto change = role_change(event);
  if (change && (event.controls.role() != change->role || !same_identity(event.controls.identity(), change->identity)))
    return Error{"its event is of another role than was asked for"};
  return event;
}

bool equal(const Control& a, const Control& b) { return a.SerializeAsString() == b.SerializeAsString(); }

Status expect(const Control& expected, const Control& after) {
  return equal(expected, after) ? Status(done) : Error{"its record does not follow from the one before"};
}

Status check_granted(const LeaseCall& asked, const Control& before, const Creator& creator) {
  const Rights rights = rights_of(before, to_message(creator.name));
  return rights.fly && asked.priority() <= rights.max_priority ? Status(done)
                                                               : Error{"its creator is not granted that"};
}

// What role it has stays the peer's word.
Status check_delegate(const LeaseCall& asked, const Control& before, const Creator& creator) {
  if (!asked.has_delegate()) return done;
  if (!may_delegate(to_message(creator.name), asked.delegate()))
    return Error{"its delegate is none that its creator may have"};
  return is_revoked(before, asked.delegate()) ? Status(Error{"its delegate is revoked"}) : Status(done);
}

Status acquired(const LeaseCall& asked, const Control& before, const Control& after, const Creator& creator) {
  const Identity self = to_message(creator.name);
  const bool mine = same(before.holder(), creator.name);
  if (Status status = check_granted(asked, before, creator); !status) return status;
  if (Status status = check_delegate(asked, before, creator); !status) return status;
  const bool free = !before.has_holder() || is_lease_revoked(before);
  if (!free && !mine && asked.priority() <= before.priority())
    return Error{"somebody holds the lease with no lower priority"};
  const bool goes_on = is_lease_of(before, self, delegate_in(asked));
  if (!goes_on && after.epoch() <= before.epoch()) return Error{"its epoch does not grow"};
  Control expected = before;
  begin_lease(expected, self, delegate_in(asked), after.epoch(), asked.priority());
  remove_request(expected, self);
  return expect(expected, after);
}

Status lease_ended(const Control& before, const Control& after) {
  if (after.epoch() <= before.epoch()) return Error{"its epoch does not grow"};
  Control expected = before;
  end_lease(expected, after.epoch());
  return expect(expected, after);
}

Status released(const Control& before, const Control& after, const Creator& creator) {
  if (!before.has_holder() || !same(before.holder(), creator.name)) return Error{"another one holds the lease"};
  return lease_ended(before, after);
}

Status requested(const LeaseCall& asked, const Control& before, const Control& after, const Creator& creator) {
  if (Status status = check_granted(asked, before, creator); !status) return status;
  if (Status status = check_delegate(asked, before, creator); !status) return status;
  Control expected = before;
  add_request(expected, to_message(creator.name), delegate_in(asked), asked.priority());
  return expect(expected, after);
}

Status handed_over(const AnswerCall& asked, const Control& before, const Control& after, const Creator& creator) {
  if (!before.has_holder() || !same(before.holder(), creator.name)) return Error{"another one holds the lease"};
  if (is_revoked(before, before.holder())) return Error{"its creator is revoked"};
  if (after.epoch() <= before.epoch()) return Error{"its epoch does not grow"};
  Control expected = before;
  if (!hand_over_lease(expected, asked.to(), after.epoch()))
    return Error{"who gets the lease has not requested it, or is not granted it"};
  return expect(expected, after);
}

Status denied(const AnswerCall& asked, const Control& before, const Control& after, const Creator& creator) {
  const bool holder = same(before.holder(), creator.name) && !is_revoked(before, before.holder());
  if (!holder && !same(asked.to(), creator.name))
    return Error{"its creator is neither the holder nor who has requested"};
  Control expected = before;
  remove_request(expected, asked.to());
  return expect(expected, after);
}

Status evicted(const DronesCall& asked, const Control& before, const Control& after, const Creator& creator) {
  if (before.owner().msp_id() != creator.name.msp_id) return Error{"its creator is of another organisation"};
  if (!before.has_holder()) return Error{"nobody held the lease"};
  if (!asked.epochs().empty() && said_of(asked, asked.epochs(), before.drone()) != before.epoch())
    return Error{"its lease is not the one that was asked for"};
  return lease_ended(before, after);
}

Status granted(const GrantCall& asked, const Control& before, const Control& after, const Creator& creator) {
  if (!creator.admin || before.owner().msp_id() != creator.name.msp_id)
    return Error{"its creator is no administrator of the drone's organisation"};
  Control expected = before;
  set_grant(expected, asked.grant(), after.epoch());
  if (before.has_holder() && !expected.has_holder() && after.epoch() <= before.epoch())
    return Error{"its epoch does not grow"};
  return expect(expected, after);
}

Status stop_cleared(const Control& before, const Control& after, const Creator& creator) {
  Control expected = before;
  clear_stops(expected, to_message(creator.name), after.stoppers().empty());  // its role stays the peer's word
  return expect(expected, after);
}

Status enrolled(const EnrollCall& asked, const Control& before, const Control& after, const Creator& creator) {
  const std::string& organisation = asked.identity().msp_id();
  if (!creator.admin || creator.name.msp_id != organisation)
    return Error{"its creator is no administrator of that organisation"};
  if (before.owner().msp_id() != organisation) return Error{"the drone is another organisation's"};
  Control expected = before;
  *expected.mutable_owner() = asked.identity();
  *expected.mutable_former_owners() = after.former_owners();
  if (asked.role() != ROLE_NONE) apply_role(expected, asked.identity(), asked.role());
  return expect(expected, after);
}

Status stops_applied(const Control& before, const Control& after, const Creator& creator) {
  if (!same(before.owner(), creator.name)) return Error{"its creator is not the drone's host"};
  Control expected = before;
  end_revoked(expected, after.epoch());
  if (before.has_holder() && !expected.has_holder() && after.epoch() <= before.epoch())
    return Error{"its epoch does not grow"};
  return expect(expected, after);
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

Status control_follows(const ControlEvent& event, const Control& before, const Control& after, const Creator& creator) {
  if (after.drone() != before.drone()) return Error{"its record is of another drone"};
  if (after.epoch() < before.epoch()) return Error{"its epoch goes back"};
  if (equal(before, after)) return done;
  if (event.function == contract::acquire) return acquired(std::get<LeaseCall>(event.asked), before, after, creator);
  if (event.function == contract::release) return released(before, after, creator);
  if (event.function == contract::grant) return granted(std::get<GrantCall>(event.asked), before, after, creator);
  if (event.function == contract::request) return requested(std::get<LeaseCall>(event.asked), before, after, creator);
  if (event.function == contract::hand_over)
    return handed_over(std::get<AnswerCall>(event.asked), before, after, creator);
  if (event.function == contract::deny) return denied(std::get<AnswerCall>(event.asked), before, after, creator);
  if (event.function == contract::evict) return evicted(std::get<DronesCall>(event.asked), before, after, creator);
  if (event.function == contract::clear_stop) return stop_cleared(before, after, creator);
  if (event.function == contract::apply_stops) return stops_applied(before, after, creator);
  if (event.function == contract::enroll) return enrolled(std::get<EnrollCall>(event.asked), before, after, creator);
  return Error{"a " + event.function + " changes no record"};
}

std::optional<RoleChange> role_change(const ControlEvent& event) {
  if (const auto* revoked = std::get_if<RevokeCall>(&event.asked)) return RoleChange{revoked->identity(), REVOKED};
  const auto* enrolled = std::get_if<EnrollCall>(&event.asked);
  if (!enrolled || enrolled->role() == ROLE_NONE) return std::nullopt;
  return RoleChange{enrolled->identity(), enrolled->role()};
}

Status role_follows(const RoleChange& change, const Creator& creator) {
  if (creator.admin && creator.name.msp_id == change.identity.msp_id()) return done;
  return Error{"its creator is no administrator of that organisation"};
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

bool may_stop(const Control& record, Role role, const Identity& who) {
  return is_operator(role) && rights_of(record, who).stop;
}

Status stop_follows(const ControlEvent& event, const Control& before, const Stop& stop, const Creator& creator) {
  if (event.function != contract::stop) return Error{"it is no stop"};
  if (!same(stop.stopper(), creator.name) || stop.cleared()) return Error{"it is not its creator's own stop"};
  if (stop.cut() != std::get<DronesCall>(event.asked).cut()) return Error{"its cut is not as it was asked for"};
  if (stop.cut() && !rights_of(before, to_message(creator.name)).cut)
    return Error{"its creator may not cut this drone's motors"};
  const auto& asked = std::get<DronesCall>(event.asked);
  if (!asked.clears().empty() && said_of(asked, asked.clears(), stop.drone()) != stop.clears())
    return Error{"it is not for the count of clears that it was asked for"};
  return done;
}

}  // namespace ledgerline::verification
