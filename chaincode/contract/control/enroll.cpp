#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// enroll and revoke: whose a drone is, and who has which role.
namespace ledgerline::chaincode {
namespace {

/// Moves what streams of a drone from its host before to the new one; whether there was any.
Result<bool> move_streams(Records<Host>& hosts, const Control& before, const Identity& identity) {
  const auto host = hosts.at(host_key(to_name(identity)), identity.msp_id());
  if (!host) return host.error();
  insert(*(*host)->mutable_drones(), before.drone());  // it may be there, and is not where the host was revoked
  if (!before.has_owner() || to_name(before.owner()) == to_name(identity)) return false;
  const auto former = hosts.at(host_key(to_name(before.owner())), identity.msp_id());
  if (!former) return former.error();
  erase(*(*former)->mutable_drones(), before.drone());
  std::vector<std::string> streams;
  for (const std::string& id : (*former)->streams()) {
    if (first_segment(id) == before.drone()) streams.push_back(id);
  }
  for (const std::string& id : streams) {
    erase(*(*former)->mutable_streams(), id);
    insert(*(*host)->mutable_streams(), id);
  }
  return !streams.empty();
}

/// Writes down whose a new drone is. Names are for good, so that each organisation has its bound.
Status add_name(Stub& stub, Records<Drones>& organisations, const Control& control) {
  const std::string& msp_id = control.owner().msp_id();
  const auto known = organisations.at(drones_key(msp_id), msp_id);
  if (!known) return known.error();
  insert(*(*known)->mutable_drones(), control.drone());
  if (static_cast<std::size_t>((*known)->drones_size()) > contract::max_organisation_drones) {
    return Error{control.drone() + ": " + msp_id + " has " + std::to_string(contract::max_organisation_drones) +
                 " drones already, which is the limit"};
  }
  Status made = make_owner(stub, control.drone(), msp_id);
  if (made) made = make_record(stub, grant_key(control.drone()), Grants(), msp_id);
  if (made) made = make_record(stub, request_key(control.drone()), Requests(), msp_id);
  return made;
}

Status check_enrolment(Stub& stub, const EnrollCall& call) {
  if (Status status = check_identity("identity", call.identity()); !status)
    return Error{"enroll: " + status.error().message};
  if (const auto why = access::check_call({contract::enroll, call}, caller_of(stub), {}))
    return Error{"enroll: " + why->text};
  if (call.drones().empty() && call.role() == ROLE_NONE) return Error{"enroll: name drones or a role"};
  if (call.role() == REVOKED) return Error{"enroll: REVOKED is no role; call revoke"};
  if (!Role_IsValid(call.role())) return Error{"enroll: unknown role " + std::to_string(call.role())};
  return check_call_size(call.drones_size(), "drones");
}

}  // namespace

Answer enroll(Stub& stub, const Arguments& call) {
  EnrollCall enrolment;
  if (call.form == Arguments::Form::plain) return Error{"enroll: give an EnrollCall in protobuf or JSON"};
  if (Status status = parse_message(call.message, enrolment); !status) return status.error();
  if (Status status = check_enrolment(stub, enrolment); !status) return status.error();

  const access::Call asked{contract::enroll, enrolment};
  const access::Caller caller = caller_of(stub);
  Controls all;
  Records<Host> hosts(stub);
  Records<Drones> organisations(stub);
  for (const std::string& drone : sorted_names(enrolment.drones())) {
    if (Status status = check_drone_name(drone); !status) return status.error();
    const auto old = read_control(stub, drone);
    if (!old) return old.error();
    if (!*old && !contract::is_drone_name(drone))
      return Error{drone + ": a new drone's name " + contract::drone_name_rule};
    Control before;
    before.set_drone(drone);
    if (*old) before = (*old)->message;
    const auto moved = move_streams(hosts, before, enrolment.identity());
    if (!moved) return moved.error();
    auto after = access::apply(before, asked, caller, {.roles = {.all = true}, .moves_streams = *moved});
    if (const auto* why = std::get_if<access::Refusal>(&after)) return Error{drone + ": " + why->text};
    Control& control = *all.add_controls();
    control = std::get<Control>(std::move(after));
    if (*old && to_name(before.owner()) == to_name(enrolment.identity())) continue;
    // One of an older version stays so until a control call renews it, with what belongs to it.
    const std::string& endorsing_msp = enrolment.identity().msp_id();
    const Status written = *old ? write_record(stub, control_key(drone), stored_part(control), (*old)->version)
                                : make_record(stub, control_key(drone), stored_part(control), endorsing_msp);
    if (!written) return written.error();
    if (*old) continue;
    if (Status status = add_name(stub, organisations, control); !status) return status.error();
  }
  if (!enrolment.drones().empty()) {
    if (Status status = renew_host(stub, hosts, to_name(enrolment.identity())); !status) return status.error();
  }
  if (Status status = hosts.write(); !status) return status.error();
  if (Status status = organisations.write(); !status) return status.error();
  if (Status status = write_role(stub, to_name(enrolment.identity()), enrolment.role()); !status)
    return Error{"enroll: " + status.error().message};
  *all.mutable_identity() = enrolment.identity();
  all.set_role(enrolment.role());
  return publish(stub, call, contract::enroll, all);
}

Answer revoke(Stub& stub, const Arguments& call) {
  RevokeCall asked;
  if (call.form == Arguments::Form::plain) return Error{"revoke: give a RevokeCall in protobuf or JSON"};
  if (Status status = parse_message(call.message, asked); !status) return status.error();
  const Identity& who = asked.identity();
  if (Status status = check_identity("identity", who); !status) return Error{"revoke: " + status.error().message};
  if (const auto why = access::check_call({contract::revoke, asked}, caller_of(stub), {}))
    return Error{"revoke: " + why->text};
  if (Status status = write_role(stub, to_name(who), REVOKED); !status)
    return Error{"revoke: " + status.error().message};
  Records<Host> hosts(stub);  // of a drone host: nothing that it sends has an owner any more
  const auto host = hosts.at(host_key(to_name(who)), who.msp_id());
  if (!host) return host.error();
  if (Status status = renew_host(stub, hosts, to_name(who)); !status) return status.error();
  (*host)->clear_drones();
  if (Status status = hosts.write(); !status) return status.error();
  Controls event;
  *event.mutable_identity() = who;
  event.set_role(REVOKED);
  return publish(stub, call, contract::revoke, event);
}

}  // namespace ledgerline::chaincode
