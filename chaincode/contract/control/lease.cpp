#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// acquire, release, request, hand_over, deny and evict: who flies a drone; and grant: what other organisations may do
/// with it.
namespace ledgerline::chaincode {
namespace {

/// acquire or request.
Answer change_lease(Stub& stub, const Arguments& call, const std::string& function) {
  return change_drones<LeaseCall>(stub, call, function, [&](LeaseCall& lease) -> Status {
    const Error not_a_priority{"priority must be a number up to " + std::to_string(contract::max_priority)};
    const std::string option = call.option("priority", "");
    if (option.size() > 9 || option.find_first_not_of("0123456789") != std::string::npos) return not_a_priority;
    if (!option.empty()) lease.set_priority(static_cast<std::uint32_t>(std::stoul(option)));
    if (lease.priority() > contract::max_priority) return not_a_priority;
    return lease.has_delegate() ? check_identity("delegate", lease.delegate()) : done;
  });
}

/// hand_over or deny.
Answer answer_request(Stub& stub, const Arguments& call, const std::string& function) {
  if (call.form == Arguments::Form::plain) return Error{function + ": give an AnswerCall in protobuf or JSON"};
  return change_drones<AnswerCall>(stub, call, function, [](const AnswerCall& asked) -> Status {
    const bool named = !asked.to().msp_id().empty() && !asked.to().subject().empty();
    return named ? Status(done) : Error{"to needs mspId and subject"};
  });
}

Status check_grant(const Grant& grant) {
  if (grant.to().msp_id().empty()) return Error{"to needs mspId; without a subject it is all of that organisation"};
  if (Status status = check_length("to", grant.to()); !status) return status;
  if (grant.max_priority() > contract::max_priority) {
    return Error{"maxPriority must be a number up to " + std::to_string(contract::max_priority)};
  }
  if (grant.max_priority() > 0 && !grant.fly()) return Error{"maxPriority is of those who may fly; set fly, too"};
  return done;
}

}  // namespace

Answer acquire(Stub& stub, const Arguments& call) { return change_lease(stub, call, contract::acquire); }
Answer request(Stub& stub, const Arguments& call) { return change_lease(stub, call, contract::request); }
Answer hand_over(Stub& stub, const Arguments& call) { return answer_request(stub, call, contract::hand_over); }
Answer deny(Stub& stub, const Arguments& call) { return answer_request(stub, call, contract::deny); }

Answer release(Stub& stub, const Arguments& call) {
  return change_drones<LeaseCall>(stub, call, contract::release, [](const LeaseCall& lease) -> Status {
    if (lease.has_delegate()) return Error{"a delegate is of acquire and request alone; leave it out"};
    return done;
  });
}

Answer evict(Stub& stub, const Arguments& call) {
  return change_drones<DronesCall>(stub, call, contract::evict, [](const DronesCall& asked) {
    return check_beside("epochs", asked.epochs_size(), asked.drones_size());
  });
}

Answer grant(Stub& stub, const Arguments& call) {
  if (call.form == Arguments::Form::plain) return Error{"grant: give a GrantCall in protobuf or JSON"};
  return change_drones<GrantCall>(stub, call, contract::grant,
                                  [](const GrantCall& asked) { return check_grant(asked.grant()); });
}

}  // namespace ledgerline::chaincode
