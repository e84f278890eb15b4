#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/requests.hpp"

/// acquire, release, request, hand_over, deny and evict: who flies a drone.
namespace ledgerline::chaincode {
namespace {

Error not_a_priority(const std::string& function) {
  return Error{function + ": priority must be a number up to " + std::to_string(contract::max_priority)};
}

/// acquire or request.
Result<LeaseCall> read_lease_call(const Arguments& call, const std::string& function) {
  auto lease = read_drones<LeaseCall>(call);
  if (!lease) return Error{function + ": " + lease.error().what};
  const std::string option = call.option("priority", "");
  if (!option.empty()) {
    if (option.size() > 9 || option.find_first_not_of("0123456789") != std::string::npos)
      return not_a_priority(function);
    lease->set_priority(static_cast<std::uint32_t>(std::stoul(option)));
  }
  if (lease->priority() > contract::max_priority) return not_a_priority(function);
  return lease;
}

/// Why somebody may not let the delegate of its acquire or request command. It needs no role: it commands under a
/// lease, and may do nothing else by it.
Status check_delegate(Stub& stub, const std::string& function, const Identity& delegate) {
  const crypto::IdentityName who = to_name(delegate), &holder = stub.caller();
  if (who.msp_id.empty() || who.subject.empty()) return Error{function + ": delegate needs mspId and subject"};
  for (const std::string& part : {who.msp_id, who.subject}) {
    if (part.size() <= contract::max_subject_chars) continue;
    return Error{function + ": delegate has " + std::to_string(part.size()) + " characters; the limit is " +
                 std::to_string(contract::max_subject_chars)};
  }
  if (who == holder) {
    return Error{function + ": delegate is " + to_text(holder) + " itself, who commands without one; leave it out"};
  }
  if (!may_delegate(to_message(holder), delegate)) {
    return Error{function + ": " + to_text(who) + " cannot command for " + to_text(holder) +
                 ": a delegate is of its holder's organisation"};
  }
  const auto role = read_role(stub, who);
  if (!role) return role.error();
  if (*role == REVOKED) return Error{function + ": delegate " + revoked_text(who)};
  if (takes_back(*role)) return Error{function + ": delegate " + to_text(who) + " is an auditor, who commands nothing"};
  return done;
}

bool is_held(const Control& control) { return control.has_holder() && !is_lease_revoked(control); }

/// Why an operator may not fly the drone at this priority, no matter who flies it now.
Status check_rights(const Control& control, const Identity& who, std::uint32_t priority) {
  const std::string& owner = control.owner().msp_id();
  const Rights rights = rights_of(control, who);
  if (!rights.fly) {
    return Error{to_text(to_name(who)) + " may not fly it: " + owner +
                 " has granted that neither to this identity nor to " + who.msp_id() + "; an administrator of " +
                 owner + " may"};
  }
  if (priority > rights.max_priority) {
    return Error{owner + " has granted " + to_text(to_name(who)) + " priorities up to " +
                 std::to_string(rights.max_priority) + ", not " + std::to_string(priority) + "; an administrator of " +
                 owner + " may grant more"};
  }
  return done;
}

/// Why it may not have the lease now.
Status check_lease(const Control& control, const Identity& who, std::uint32_t priority) {
  if (Status status = check_rights(control, who, priority); !status) return status;
  if (is_held(control) && !same_identity(control.holder(), who) && priority <= control.priority()) {
    return Error{"the lease is held by " + to_text(to_name(control.holder())) + " with priority " +
                 std::to_string(control.priority()) +
                 ", who may release it, or hand it over on request; a supervisor of " + control.owner().msp_id() +
                 " may evict it"};
  }
  return done;
}

bool holds(const Control& control, const crypto::IdentityName& who) {
  return control.has_holder() && to_name(control.holder()) == who;
}

Error not_the_holder(const Control& control, const crypto::IdentityName& who) {
  return Error{to_text(who) + " does not hold the lease; " +
               (!control.has_holder()    ? "nobody does, and who is granted it may acquire it"
                : control.has_delegate() ? holder_text(control) + " and may itself hand it over on request"
                                         : holder_text(control) + " does, who may hand it over on request")};
}

/// Why somebody may not act as the drone's holder.
Status check_holder(const Control& control, const crypto::IdentityName& who) {
  if (!holds(control, who)) return not_the_holder(control, who);
  return is_revoked(control, control.holder()) ? Status(Error{revoked_text(who)}) : Status(done);
}

/// Why a lease that somebody has requested cannot be handed over with its delegate, who may have lost its role since.
Status check_requested_delegate(Stub& stub, const Control& control, const Identity& to) {
  const Request* request = request_of(control, to);
  if (request == nullptr || !request->has_delegate()) return done;
  const crypto::IdentityName delegate = to_name(request->delegate());
  const auto role = read_role(stub, delegate);
  if (!role) return role.error();
  if (!takes_back(*role)) return done;
  return Error{to_text(to_name(to)) + " has requested it for " + to_text(delegate) +
               ", whose organisation lets it command no more; it may request it again"};
}

Result<AnswerCall> read_answer(const Arguments& call, const std::string& function) {
  if (call.form == Arguments::Form::plain) return Error{function + ": give an AnswerCall in protobuf or JSON"};
  auto asked = read_drones<AnswerCall>(call);
  if (!asked) return Error{function + ": " + asked.error().what};
  if (asked->to().msp_id().empty() || asked->to().subject().empty())
    return Error{function + ": to needs mspId and subject"};
  return asked;
}

}  // namespace

Response acquire(Stub& stub, const Arguments& call) {
  const auto lease = read_lease_call(call, contract::acquire);
  if (!lease) return refuse(lease.error().what);
  if (Status status = check_operator(stub, stub.caller(), contract::acquire); !status)
    return refuse(status.error().what);
  if (lease->has_delegate()) {
    if (Status status = check_delegate(stub, contract::acquire, lease->delegate()); !status)
      return refuse(status.error().what);
  }
  const Identity self = to_message(stub.caller());
  return change_controls(stub, call, contract::acquire, lease->drones(),
                         [&](Control& control, std::uint64_t new_epoch) -> Status {
                           if (Status status = check_lease(control, self, lease->priority()); !status) return status;
                           begin_lease(control, self, delegate_in(*lease), new_epoch, lease->priority());
                           remove_request(control, self);
                           return done;
                         });
}

Response release(Stub& stub, const Arguments& call) {
  const auto lease = read_drones<LeaseCall>(call);
  if (!lease) return refuse("release: " + lease.error().what);
  if (lease->has_delegate()) return refuse("release: a delegate is of acquire and request alone; leave it out");
  return change_controls(stub, call, contract::release, lease->drones(),
                         [&](Control& control, std::uint64_t new_epoch) -> Status {
                           // A revoked one may give back what it holds.
                           if (!holds(control, stub.caller())) return not_the_holder(control, stub.caller());
                           end_lease(control, new_epoch);
                           return done;
                         });
}

Response request(Stub& stub, const Arguments& call) {
  const auto lease = read_lease_call(call, contract::request);
  if (!lease) return refuse(lease.error().what);
  if (Status status = check_operator(stub, stub.caller(), contract::request); !status)
    return refuse(status.error().what);
  if (lease->has_delegate()) {
    if (Status status = check_delegate(stub, contract::request, lease->delegate()); !status)
      return refuse(status.error().what);
  }
  const Identity self = to_message(stub.caller());
  return change_controls(stub, call, contract::request, lease->drones(),
                         [&](Control& control, std::uint64_t) -> Status {
                           if (Status status = check_rights(control, self, lease->priority()); !status) return status;
                           if (!is_held(control)) return Error{"nobody holds the lease; acquire it"};
                           if (same_identity(control.holder(), self)) {
                             return Error{to_text(stub.caller()) + " holds the lease already"};
                           }
                           add_request(control, self, delegate_in(*lease), lease->priority());
                           const auto of_us = std::ranges::count(control.requests(), self.msp_id(),
                                                                 [](const Request& one) { return one.who().msp_id(); });
                           if (static_cast<std::size_t>(of_us) > contract::max_drone_requests) {
                             return Error{"it has " + std::to_string(contract::max_drone_requests) + " requests of " +
                                          self.msp_id() + " already, which is the limit; its holder may deny some"};
                           }
                           return done;
                         });
}

Response hand_over(Stub& stub, const Arguments& call) {
  const auto asked = read_answer(call, contract::hand_over);
  if (!asked) return refuse(asked.error().what);
  const crypto::IdentityName to = to_name(asked->to());
  if (Status status = check_operator(stub, to, contract::hand_over); !status) return refuse(status.error().what);
  return change_controls(stub, call, contract::hand_over, asked->drones(),
                         [&](Control& control, std::uint64_t new_epoch) -> Status {
                           if (Status status = check_holder(control, stub.caller()); !status) return status;
                           if (Status status = check_requested_delegate(stub, control, asked->to()); !status)
                             return status;
                           if (hand_over_lease(control, asked->to(), new_epoch)) return done;
                           return Error{to_text(to) +
                                        " has not requested it, or is not granted it any more; it may request it, an "
                                        "administrator of " +
                                        control.owner().msp_id() + " may grant it"};
                         });
}

Response deny(Stub& stub, const Arguments& call) {
  const auto asked = read_answer(call, contract::deny);
  if (!asked) return refuse(asked.error().what);
  const crypto::IdentityName to = to_name(asked->to());
  return change_controls(stub, call, contract::deny, asked->drones(), [&](Control& control, std::uint64_t) -> Status {
    const Status holder = check_holder(control, stub.caller());
    if (!holder && to != stub.caller()) {
      return Error{to_text(stub.caller()) +
                   " may not deny it: only the lease's holder, or who has requested it, may: " + holder.error().what};
    }
    if (!remove_request(control, asked->to())) return Error{to_text(to) + " has not requested it; nothing to deny"};
    return done;
  });
}

Response evict(Stub& stub, const Arguments& call) {
  const auto target = read_drones<DronesCall>(call);
  if (!target) return refuse("evict: " + target.error().what);
  if (Status status = check_beside("epochs", target->epochs_size(), target->drones_size()); !status)
    return refuse("evict: " + status.error().what);
  const auto role = read_role(stub, stub.caller());
  if (!role) return refuse(role.error().what);
  if (*role == REVOKED) return refuse("evict: " + revoked_text(stub.caller()));
  return change_controls(
      stub, call, contract::evict, target->drones(), [&](Control& control, std::uint64_t new_epoch) -> Status {
        const std::string& owner = control.owner().msp_id();
        const bool supervisor = *role == SUPERVISOR && stub.caller().msp_id == owner;
        if (!supervisor && to_name(control.owner()) != stub.caller()) {
          return Error{to_text(stub.caller()) + " may not evict: neither a supervisor of " + owner +
                       " nor the drone's host, who may"};
        }
        if (!control.has_holder()) return Error{"nobody holds the lease; there is nothing to evict"};
        const auto meant = said_of(*target, target->epochs(), control.drone());
        if (meant && *meant != control.epoch()) {
          return Error{"its lease is not the one of epoch " + std::to_string(*meant) + " any more: " +
                       to_text(to_name(control.holder())) + " holds it under epoch " + std::to_string(control.epoch())};
        }
        end_lease(control, new_epoch);
        return done;
      });
}

}  // namespace ledgerline::chaincode
