#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/grants.hpp"

/// grant: what other organisations may do with a drone.
namespace ledgerline::chaincode {
namespace {

Status check_grant(const Grant& grant) {
  if (grant.to().msp_id().empty()) return Error{"to needs mspId; without a subject it is all of that organisation"};
  for (const std::string& part : {grant.to().msp_id(), grant.to().subject()}) {
    if (part.size() > contract::max_subject_chars) {
      return Error{"to has " + std::to_string(part.size()) + " characters; the limit is " +
                   std::to_string(contract::max_subject_chars)};
    }
  }
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
  if (!asked) return refuse("grant: " + asked.error().what);
  if (Status status = check_grant(asked->grant()); !status) return refuse("grant: " + status.error().what);
  const std::string& to = asked->grant().to().msp_id();
  // Withdrawn it may be at any time.
  const bool gives = asked->grant().fly() || asked->grant().stop() || asked->grant().cut();
  if (const auto role = read_role(stub, to_name(asked->grant().to())); !role || (gives && takes_back(*role))) {
    const Status status = role ? check_operator(to_name(asked->grant().to()), *role) : Status(role.error());
    return refuse("grant: " + status.error().what);
  }
  return change_controls(
      stub, call, contract::grant, asked->drones(), [&](Control& control, std::uint64_t new_epoch) -> Status {
        const std::string& owner = control.owner().msp_id();
        if (!stub.caller_is_admin() || stub.caller().msp_id != owner) {
          return Error{to_text(stub.caller()) + " may not grant it: only an administrator of " + owner + " may"};
        }
        if (to == owner) return Error{"operators and supervisors of " + owner + " need no grant; take the role away"};
        set_grant(control, asked->grant(), new_epoch);
        if (static_cast<std::size_t>(control.grants_size()) > contract::max_drone_grants) {
          return Error{"it has " + std::to_string(contract::max_drone_grants) +
                       " grants already, which is the limit; an administrator of " + owner + " may withdraw some"};
        }
        return done;
      });
}

}  // namespace ledgerline::chaincode
