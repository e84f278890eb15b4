#include "chaincode/contract/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// acquire and release: who flies a drone.
namespace ledgerline::chaincode {

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

  return change_controls(stub, call, contract::acquire, lease->drones(),
                         [&](Control& control, std::uint64_t new_epoch) -> Status {
                           const bool mine = control.has_holder() && to_name(control.holder()) == stub.caller();
                           if (control.has_holder() && !mine && lease->priority() <= control.priority()) {
                             return Error{"the lease is held by " + to_text(to_name(control.holder())) +
                                          " with priority " + std::to_string(control.priority())};
                           }
                           if (!mine) {
                             *control.mutable_holder() = to_message(stub.caller());
                             control.set_epoch(new_epoch);
                           }
                           control.set_priority(lease->priority());
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
                           control.clear_holder();
                           control.set_priority(0);
                           control.set_epoch(new_epoch);
                           return done;
                         });
}

}  // namespace ledgerline::chaincode
