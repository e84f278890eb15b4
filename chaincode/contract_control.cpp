#include <algorithm>
#include <functional>

#include "chaincode/call.hpp"
#include "chaincode/limits.hpp"

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

/// Changes the control record of each drone. `change` says whether it has to be written, or why it is refused (without
/// the drone's name, which comes first in every refusal). Event and answer hold all records as they now are.
Response change_controls(Stub& stub, const Arguments& call, const std::string& event, std::vector<std::string> drones,
                         const std::function<Result<bool>(Control&)>& change) {
  std::sort(drones.begin(), drones.end());
  drones.erase(std::unique(drones.begin(), drones.end()), drones.end());
  Controls all;
  for (const std::string& drone : drones) {
    if (Status status = check_drone_name(drone); !status) return refuse(status.error().what);
    auto control = read_control(stub, drone);
    if (!control) return refuse(control.error().what);
    if (!*control) return refuse(drone + ": not enrolled");
    const auto changed = change(**control);
    if (!changed) return refuse(drone + ": " + changed.error().what);
    if (*changed) {
      if (Status status = write_control(stub, **control); !status) return refuse(status.error().what);
    }
    *all.add_controls() = std::move(**control);
  }
  const std::string payload = write_form(call, all);
  stub.set_event(event, payload);
  return {200, {}, payload};
}

std::vector<std::string> names(const google::protobuf::RepeatedPtrField<std::string>& list) {
  return {list.begin(), list.end()};
}

/// Binds one drone; says whether the record has to be written.
Result<bool> bind(Control& control, const std::optional<Control>& old, const Identity& identity) {
  if (!old) {
    *control.mutable_owner() = identity;
    return true;
  }
  control = *old;
  if (old->owner().msp_id() != identity.msp_id()) {
    return Error{old->drone() + ": enrolled to organisation " + old->owner().msp_id() + " already"};
  }
  if (to_name(old->owner()) == to_name(identity)) return false;
  if (!control.streams().empty()) *control.add_former_owners() = old->owner();
  *control.mutable_owner() = identity;
  return true;
}

Status write_role(Stub& stub, const EnrollCall& enrolment) {
  EnrollCall record;
  *record.mutable_identity() = enrolment.identity();
  record.set_role(enrolment.role());
  Asset asset;
  asset.set_id(role_key(to_name(enrolment.identity())));
  asset.set_topic("/" + asset.id());
  asset.set_msg_type("ledgerline.EnrollCall");
  asset.set_msg_data(record.SerializeAsString());
  return write_stored(stub, asset.id(), {asset});
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

  std::vector<std::string> drones = names(enrolment.drones());
  std::sort(drones.begin(), drones.end());
  drones.erase(std::unique(drones.begin(), drones.end()), drones.end());
  Controls all;
  for (const std::string& drone : drones) {
    if (Status status = check_drone_name(drone); !status) return refuse(status.error().what);
    const auto old = read_control(stub, drone);
    if (!old) return refuse(old.error().what);
    Control& control = *all.add_controls();
    control.set_drone(drone);
    const auto changed = bind(control, *old, enrolment.identity());
    if (!changed) return refuse(changed.error().what);
    if (!*changed) continue;
    if (Status status = write_control(stub, control); !status) return refuse(status.error().what);
  }
  if (enrolment.role() != ROLE_NONE) {
    const auto role = read_role(stub, to_name(enrolment.identity()));
    if (!role) return refuse(role.error().what);
    if (*role != enrolment.role()) {
      if (Status status = write_role(stub, enrolment); !status) return refuse(status.error().what);
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

  return change_controls(stub, call, "acquire", names(lease->drones()), [&](Control& control) -> Result<bool> {
    const bool mine = control.has_holder() && to_name(control.holder()) == stub.caller();
    if (control.has_holder() && !mine && lease->priority() <= control.priority()) {
      return Error{"the lease is held by " + to_text(to_name(control.holder())) + " with priority " +
                   std::to_string(control.priority())};
    }
    if (mine && control.priority() == lease->priority()) return false;
    if (!mine) {
      *control.mutable_holder() = to_message(stub.caller());
      control.set_epoch(control.epoch() + 1);
    }
    control.set_priority(lease->priority());
    return true;
  });
}

Response release(Stub& stub, const Arguments& call) {
  const auto lease = read_drones<LeaseCall>(call);
  if (!lease) return refuse("release: " + lease.error().what);
  return change_controls(stub, call, "release", names(lease->drones()), [&](Control& control) -> Result<bool> {
    if (!control.has_holder() || to_name(control.holder()) != stub.caller()) {
      return Error{to_text(stub.caller()) + " does not hold the lease"};
    }
    control.clear_holder();
    control.set_priority(0);
    control.set_epoch(control.epoch() + 1);
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

  return change_controls(stub, call, "stop", names(target->drones()), [&](Control& control) -> Result<bool> {
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

  return change_controls(stub, call, "resume", names(target->drones()), [&](Control& control) -> Result<bool> {
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
