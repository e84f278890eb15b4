#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// grant: what other organisations may do with a drone.
namespace ledgerline::chaincode {
namespace {

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

Response grant(Stub& stub, const Arguments& call) {
  if (call.form == Arguments::Form::plain) return refuse("grant: give a GrantCall in protobuf or JSON");
  const auto asked = read_drones<GrantCall>(call);
  if (!asked) return refuse("grant: " + asked.error().message);
  if (Status status = check_grant(asked->grant()); !status) return refuse("grant: " + status.error().message);
  return change_controls(stub, call, {contract::grant, *asked}, asked->drones());
}

}  // namespace ledgerline::chaincode
