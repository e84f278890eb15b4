#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// acquire, release, request, hand_over, deny and evict: who flies a drone.
namespace ledgerline::chaincode {
namespace {

Error not_a_priority(const std::string& function) {
  return Error{function + ": priority must be a number up to " + std::to_string(contract::max_priority)};
}

/// acquire or request.
Result<LeaseCall> read_lease_call(const Arguments& call, const std::string& function) {
  auto lease = read_drones<LeaseCall>(call);
  if (!lease) return Error{function + ": " + lease.error().message};
  const std::string option = call.option("priority", "");
  if (!option.empty()) {
    if (option.size() > 9 || option.find_first_not_of("0123456789") != std::string::npos)
      return not_a_priority(function);
    lease->set_priority(static_cast<std::uint32_t>(std::stoul(option)));
  }
  if (lease->priority() > contract::max_priority) return not_a_priority(function);
  if (lease->has_delegate()) {
    if (Status status = check_identity("delegate", lease->delegate()); !status)
      return Error{function + ": " + status.error().message};
  }
  return lease;
}

/// acquire or request.
Response change_lease(Stub& stub, const Arguments& call, const std::string& function) {
  const auto lease = read_lease_call(call, function);
  if (!lease) return refuse(lease.error().message);
  return change_controls(stub, call, {function, *lease}, lease->drones());
}

/// hand_over or deny.
Response answer(Stub& stub, const Arguments& call, const std::string& function) {
  if (call.form == Arguments::Form::plain) return refuse(function + ": give an AnswerCall in protobuf or JSON");
  const auto asked = read_drones<AnswerCall>(call);
  if (!asked) return refuse(function + ": " + asked.error().message);
  if (asked->to().msp_id().empty() || asked->to().subject().empty())
    return refuse(function + ": to needs mspId and subject");
  return change_controls(stub, call, {function, *asked}, asked->drones());
}

}  // namespace

Response acquire(Stub& stub, const Arguments& call) { return change_lease(stub, call, contract::acquire); }
Response request(Stub& stub, const Arguments& call) { return change_lease(stub, call, contract::request); }
Response hand_over(Stub& stub, const Arguments& call) { return answer(stub, call, contract::hand_over); }
Response deny(Stub& stub, const Arguments& call) { return answer(stub, call, contract::deny); }

Response release(Stub& stub, const Arguments& call) {
  const auto lease = read_drones<LeaseCall>(call);
  if (!lease) return refuse("release: " + lease.error().message);
  if (lease->has_delegate()) return refuse("release: a delegate is of acquire and request alone; leave it out");
  return change_controls(stub, call, {contract::release, *lease}, lease->drones());
}

Response evict(Stub& stub, const Arguments& call) {
  const auto target = read_drones<DronesCall>(call);
  if (!target) return refuse("evict: " + target.error().message);
  if (Status status = check_beside("epochs", target->epochs_size(), target->drones_size()); !status)
    return refuse("evict: " + status.error().message);
  return change_controls(stub, call, {contract::evict, *target}, target->drones());
}

}  // namespace ledgerline::chaincode
