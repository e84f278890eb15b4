#include <algorithm>
#include <functional>

#include "chaincode/limits.hpp"
#include "chaincode/records.hpp"

/// enroll, acquire, release, stop and resume: who may fly what.
namespace ledgerline::chaincode {
namespace {

bool may_operate(Role role) { return role == OPERATOR || role == SUPERVISOR; }

template <typename Message>
Result<Message> read_drones(const Arguments& call) {
  Message message;
  if (call.form == Arguments::Form::plain) {
    for (const std::string& name : call.names) message.add_drones(name);
  } else if (Status status = parse_message(call.message, message); !status) {
    return status.error();
  }
  if (message.drones().empty()) return Error{"no drone is named"};
  if (static_cast<std::size_t>(message.drones_size()) > max_call_assets) {
    return Error{"the call has " + std::to_string(message.drones_size()) + " drones; the limit is " +
                 std::to_string(max_call_assets)};
  }
  return message;
}

std::vector<std::string> sorted_names(const Names& list) {
  std::vector<std::string> names(list.begin(), list.end());
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

/// Keeps the leases true to a control record that has changed.
Status follow(Records<Lease>& leases, const Control& before, const Control& after) {
  const auto key = [](const Control& control) {
    return control.has_holder() ? lease_key(to_name(control.holder()), control.epoch()) : std::string();
  };
  const std::string from = key(before), to = key(after);
  if (!from.empty() && from != to) {
    const auto lease = leases.at(from);
    if (!lease) return lease.error();
    erase(*(*lease)->mutable_drones(), before.drone());
    erase(*(*lease)->mutable_stopped(), before.drone());
  }
  if (to.empty()) return done;
  const auto lease = leases.at(to);
  if (!lease) return lease.error();
  insert(*(*lease)->mutable_drones(), after.drone());
  (after.has_stopped_by() ? insert : erase)(*(*lease)->mutable_stopped(), after.drone());
  return done;
}

/// Changes the control record of each drone. `change` says whether it has to be written, or why it is refused (without
/// the drone's name, which comes first in every refusal); it gets an epoch that is new to all of them. Event and answer
/// hold all records as they now are.
Response change_controls(Stub& stub, const Arguments& call, const std::string& event, const Names& drones,
                         const std::function<Result<bool>(Control&, std::uint64_t new_epoch)>& change) {
  Controls all;
  std::uint64_t new_epoch = 1;
  for (const std::string& drone : sorted_names(drones)) {
    if (Status status = check_drone_name(drone); !status) return refuse(status.error().what);
    auto control = read_control(stub, drone);
    if (!control) return refuse(control.error().what);
    if (!*control) return refuse(drone + ": not enrolled");
    new_epoch = std::max(new_epoch, (*control)->epoch() + 1);
    *all.add_controls() = std::move(**control);
  }
  Records<Lease> leases(stub);
  for (Control& control : *all.mutable_controls()) {
    const Control before = control;
    const auto changed = change(control, new_epoch);
    if (!changed) return refuse(control.drone() + ": " + changed.error().what);
    if (!*changed) continue;
    if (Status status = write_control(stub, control); !status) return refuse(status.error().what);
    if (Status status = follow(leases, before, control); !status) return refuse(status.error().what);
  }
  if (Status status = leases.write(); !status) return refuse(status.error().what);
  const std::string payload = write_form(call, all);
  stub.set_event(event, payload);
  return {200, {}, payload};
}

/// Binds one drone; says whether its record has to be written. What streams goes along to the new owner.
Result<bool> bind(Records<Host>& hosts, Control& control, const std::optional<Control>& old, const Identity& identity) {
  if (old) {
    control = *old;
    if (old->owner().msp_id() != identity.msp_id()) {
      return Error{old->drone() + ": enrolled to organisation " + old->owner().msp_id() + " already"};
    }
    if (to_name(old->owner()) == to_name(identity)) return false;
  }
  const auto host = hosts.at(host_key(to_name(identity)));
  if (!host) return host.error();
  insert(*(*host)->mutable_drones(), control.drone());
  if (old) {
    const auto former = hosts.at(host_key(to_name(old->owner())));
    if (!former) return former.error();
    erase(*(*former)->mutable_drones(), control.drone());
    std::vector<std::string> streams;
    for (const std::string& id : (*former)->streams()) {
      if (first_segment(id) == control.drone()) streams.push_back(id);
    }
    for (const std::string& id : streams) {
      erase(*(*former)->mutable_streams(), id);
      insert(*(*host)->mutable_streams(), id);
    }
    if (!streams.empty()) *control.add_former_owners() = old->owner();
  }
  *control.mutable_owner() = identity;
  return true;
}

Status check_enrolment(Stub& stub, const EnrollCall& call) {
  const Identity& who = call.identity();
  if (who.msp_id().empty() || who.subject().empty()) return Error{"enroll: identity needs mspId and subject"};
  if (!stub.caller_is_admin() || stub.caller().msp_id != who.msp_id()) {
    return Error{"enroll: only an administrator of " + who.msp_id() + " may enroll its identities"};
  }
  if (call.drones().empty() && call.role() == ROLE_NONE) return Error{"enroll: name drones or a role"};
  if (!Role_IsValid(call.role())) return Error{"enroll: unknown role " + std::to_string(call.role())};
  if (static_cast<std::size_t>(call.drones_size()) > max_call_assets) {
    return Error{"the call has " + std::to_string(call.drones_size()) + " drones; the limit is " +
                 std::to_string(max_call_assets)};
  }
  return done;
}

}  // namespace

Response enroll(Stub& stub, const Arguments& call) {
  EnrollCall enrolment;
  if (call.form == Arguments::Form::plain) return refuse("enroll: give an EnrollCall in protobuf or JSON");
  if (Status status = parse_message(call.message, enrolment); !status) return refuse(status.error().what);
  if (Status status = check_enrolment(stub, enrolment); !status) return refuse(status.error().what);

  Controls all;
  Records<Host> hosts(stub);
  for (const std::string& drone : sorted_names(enrolment.drones())) {
    if (Status status = check_drone_name(drone); !status) return refuse(status.error().what);
    const auto old = read_control(stub, drone);
    if (!old) return refuse(old.error().what);
    Control& control = *all.add_controls();
    control.set_drone(drone);
    const auto changed = bind(hosts, control, *old, enrolment.identity());
    if (!changed) return refuse(changed.error().what);
    if (!*changed) continue;
    if (Status status = write_control(stub, control); !status) return refuse(status.error().what);
  }
  if (Status status = hosts.write(); !status) return refuse(status.error().what);
  if (enrolment.role() != ROLE_NONE) {
    const auto role = read_role(stub, to_name(enrolment.identity()));
    if (!role) return refuse(role.error().what);
    if (*role != enrolment.role()) {
      EnrollCall record;
      *record.mutable_identity() = enrolment.identity();
      record.set_role(enrolment.role());
      const Status status = write_record(stub, role_key(to_name(enrolment.identity())), record);
      if (!status) return refuse(status.error().what);
    }
  }
  *all.mutable_identity() = enrolment.identity();
  all.set_role(enrolment.role());
  const std::string payload = write_form(call, all);
  stub.set_event("enroll", payload);
  return {200, {}, payload};
}

Response acquire(Stub& stub, const Arguments& call) {
  auto lease = read_drones<LeaseCall>(call);
  if (!lease) return refuse("acquire: " + lease.error().what);
  const std::string option = call.option("priority", "");
  if (!option.empty()) {
    if (option.size() > 9 || option.find_first_not_of("0123456789") != std::string::npos) {
      return refuse("acquire: priority must be a number up to 999999999");
    }
    lease->set_priority(static_cast<std::uint32_t>(std::stoul(option)));
  }
  const auto role = read_role(stub, stub.caller());
  if (!role) return refuse(role.error().what);
  if (!may_operate(*role)) return refuse("acquire: " + to_text(stub.caller()) + " is neither operator nor supervisor");

  return change_controls(stub, call, "acquire", lease->drones(),
                         [&](Control& control, std::uint64_t new_epoch) -> Result<bool> {
                           const bool mine = control.has_holder() && to_name(control.holder()) == stub.caller();
                           if (control.has_holder() && !mine && lease->priority() <= control.priority()) {
                             return Error{"the lease is held by " + to_text(to_name(control.holder())) +
                                          " with priority " + std::to_string(control.priority())};
                           }
                           if (mine && control.priority() == lease->priority()) return false;
                           if (!mine) {
                             *control.mutable_holder() = to_message(stub.caller());
                             control.set_epoch(new_epoch);
                           }
                           control.set_priority(lease->priority());
                           return true;
                         });
}

Response release(Stub& stub, const Arguments& call) {
  const auto lease = read_drones<LeaseCall>(call);
  if (!lease) return refuse("release: " + lease.error().what);
  return change_controls(stub, call, "release", lease->drones(),
                         [&](Control& control, std::uint64_t new_epoch) -> Result<bool> {
                           if (!control.has_holder() || to_name(control.holder()) != stub.caller()) {
                             return Error{to_text(stub.caller()) + " does not hold the lease"};
                           }
                           control.clear_holder();
                           control.set_priority(0);
                           control.set_epoch(new_epoch);
                           return true;
                         });
}

Response stop(Stub& stub, const Arguments& call) {
  auto target = read_drones<DronesCall>(call);
  if (!target) return refuse("stop: " + target.error().what);
  const std::string option = call.option("cut", "");
  if (!option.empty() && option != "true" && option != "false") return refuse("stop: cut must be true or false");
  if (option == "true") target->set_cut(true);
  const auto role = read_role(stub, stub.caller());
  if (!role) return refuse(role.error().what);
  const bool supervisor = *role == SUPERVISOR;

  return change_controls(stub, call, "stop", target->drones(), [&](Control& control, std::uint64_t) -> Result<bool> {
    const bool own = control.owner().msp_id() == stub.caller().msp_id;
    const bool holds = control.has_holder() && to_name(control.holder()) == stub.caller();
    if (!supervisor && !(*role == OPERATOR && (own || holds))) {
      return Error{to_text(stub.caller()) + " may not stop it: neither a supervisor, nor an operator of its " +
                   "organisation or with its lease"};
    }
    const bool cut = control.cut() || target->cut();
    // A supervisor's stop takes the place of an operator's, so that the operator cannot undo it.
    const bool take_over = !control.has_stopped_by() || (supervisor && to_name(control.stopped_by()) != stub.caller());
    if (!take_over && cut == control.cut()) return false;
    if (take_over) *control.mutable_stopped_by() = to_message(stub.caller());
    control.set_cut(cut);
    return true;
  });
}

Response resume(Stub& stub, const Arguments& call) {
  const auto target = read_drones<DronesCall>(call);
  if (!target) return refuse("resume: " + target.error().what);
  const auto role = read_role(stub, stub.caller());
  if (!role) return refuse(role.error().what);

  return change_controls(stub, call, "resume", target->drones(), [&](Control& control, std::uint64_t) -> Result<bool> {
    if (!control.has_stopped_by()) return Error{"not stopped"};
    const bool stopper = to_name(control.stopped_by()) == stub.caller();
    const bool supervisor = *role == SUPERVISOR && control.owner().msp_id() == stub.caller().msp_id;
    if (!stopper && !supervisor) {
      return Error{"stopped by " + to_text(to_name(control.stopped_by())) + "; only they or a supervisor of " +
                   control.owner().msp_id() + " may resume it"};
    }
    control.clear_stopped_by();
    control.set_cut(false);
    return true;
  });
}

}  // namespace ledgerline::chaincode
