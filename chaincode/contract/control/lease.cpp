#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/grants.hpp"

/// acquire, release and evict: who flies a drone.
namespace ledgerline::chaincode {
namespace {

Error not_a_priority() {
  return Error{"acquire: priority must be a number up to " + std::to_string(contract::max_priority)};
}

Result<LeaseCall> read_acquire(const Arguments& call) {
  auto lease = read_drones<LeaseCall>(call);
  if (!lease) return Error{"acquire: " + lease.error().what};
  const std::string option = call.option("priority", "");
  if (!option.empty()) {
    if (option.size() > 9 || option.find_first_not_of("0123456789") != std::string::npos) return not_a_priority();
    lease->set_priority(static_cast<std::uint32_t>(std::stoul(option)));
  }
  if (lease->priority() > contract::max_priority) return not_a_priority();
  return lease;
}

/// Why somebody who is an operator may not have the lease at this priority.
Status check_lease(const Control& control, const Identity& who, std::uint32_t priority) {
  const std::string& owner = control.owner().msp_id();
  const Rights rights = rights_of(control, who);
  if (!rights.fly) {
    return Error{to_text(to_name(who)) + " may not fly it: " + owner +
                 " has granted that neither to this identity nor to " + who.msp_id() + "; an administrator of " +
                 owner + " may"};
  }
  if (priority > rights.max_priority) {
    return Error{owner + " has granted " + to_text(to_name(who)) + " priorities up to " +
                 std::to_string(rights.max_priority) + ", not " + std::to_string(priority)};
  }
  const bool free = !control.has_holder() || is_revoked(control, control.holder());
  if (!free && !same_identity(control.holder(), who) && priority <= control.priority()) {
    return Error{"the lease is held by " + to_text(to_name(control.holder())) + " with priority " +
                 std::to_string(control.priority()) + ", who may release it; a supervisor of " + owner +
                 " may evict it"};
  }
  return done;
}

}  // namespace

Response acquire(Stub& stub, const Arguments& call) {
  const auto lease = read_acquire(call);
  if (!lease) return refuse(lease.error().what);
  const auto role = read_role(stub, stub.caller());
  if (!role) return refuse(role.error().what);
  if (Status status = check_operator(stub.caller(), *role); !status) return refuse("acquire: " + status.error().what);
  const Identity self = to_message(stub.caller());
  return change_controls(stub, call, contract::acquire, lease->drones(),
                         [&](Control& control, std::uint64_t new_epoch) -> Status {
                           if (Status status = check_lease(control, self, lease->priority()); !status) return status;
                           begin_lease(control, self, new_epoch, lease->priority());
                           return done;
                         });
}

Response release(Stub& stub, const Arguments& call) {
  const auto lease = read_drones<LeaseCall>(call);
  if (!lease) return refuse("release: " + lease.error().what);
  return change_controls(stub, call, contract::release, lease->drones(),
                         [&](Control& control, std::uint64_t new_epoch) -> Status {
                           if (!control.has_holder() || to_name(control.holder()) != stub.caller()) {
                             return Error{to_text(stub.caller()) + " does not hold the lease"};
                           }
                           end_lease(control, new_epoch);
                           return done;
                         });
}

Response evict(Stub& stub, const Arguments& call) {
  const auto target = read_drones<DronesCall>(call);
  if (!target) return refuse("evict: " + target.error().what);
  const auto role = read_role(stub, stub.caller());
  if (!role) return refuse(role.error().what);
  if (*role == REVOKED) return refuse("evict: " + revoked_text(stub.caller()));
  return change_controls(stub, call, contract::evict, target->drones(),
                         [&](Control& control, std::uint64_t new_epoch) -> Status {
                           const std::string& owner = control.owner().msp_id();
                           const bool supervisor = *role == SUPERVISOR && stub.caller().msp_id == owner;
                           if (!supervisor && to_name(control.owner()) != stub.caller()) {
                             return Error{to_text(stub.caller()) + " may not evict: neither a supervisor of " + owner +
                                          " nor the drone's host"};
                           }
                           if (!control.has_holder()) return Error{"nobody holds the lease"};
                           end_lease(control, new_epoch);
                           return done;
                         });
}

}  // namespace ledgerline::chaincode
