#pragma once
#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "chaincode/contract/records.hpp"
#include "common/access/access.hpp"
#include "common/msg/contract.hpp"

/// What the calls share that say who may fly what: enroll, revoke, grant, acquire, release, request,
/// hand_over, deny, evict, stop, clear_stop, apply_stops and claim.
namespace ledgerline::chaincode {

access::Caller caller_of(const Stub& stub);

/// Of an identity in a call: `field` is its name there.
Status check_length(const std::string& field, const Identity& who);
Status check_identity(const std::string& field, const Identity& who);

/// A LeaseCall, DronesCall, GrantCall or AnswerCall, in any form, with at least one drone and not too many.
template <typename Message>
Result<Message> read_drones(const Arguments& call) {
  Message message;
  if (call.form == Arguments::Form::plain) {
    for (const std::string& name : call.names) message.add_drones(name);
  } else if (Status status = parse_message(call.message, message); !status) {
    return status.error();
  }
  if (message.drones().empty()) return Error{"no drone is named"};
  if (Status status = check_call_size(message.drones_size(), "drones"); !status) return status.error();
  return message;
}

/// A list that says something of each drone of a call is empty or as long as the drones.
Status check_beside(const std::string& list, int entries, int drones);

/// In order, each once.
std::vector<std::string> sorted_names(const Names& list);

/// Sees to it that an identity's host record is of this version, and its frame is there, with their policies.
Status renew_host(Stub& stub, Records<Host>& hosts, const crypto::IdentityName& host);

/// Changes the control record of each drone by the rule book; a refusal begins with the drone's name, or with the
/// function's where it is refused for any drone. Each change of holder gets an epoch that is new to all of them. What
/// is written is what differs afterwards: the record, its grants, how often stops were cleared (no stop can come), and
/// the leases that follow from these; and all of a drone's records, where they are of an older version. Event and
/// answer hold all records as they now are. A claim for the drone's organisation is over by its claimant's next
/// `evict`, `grant`, `clear_stop` or `release`; by an `evict` or `clear_stop` also where it finds nothing to change.
Answer change_controls(Stub& stub, const Arguments& call, const access::Call& asked, const Names& drones);
/// The same of a call that names its drones. `check`: of what else it says.
template <typename Message>
Answer change_drones(Stub& stub, const Arguments& call, const std::string& function,
                     const std::function<Status(Message&)>& check = {}) {
  auto asked = read_drones<Message>(call);
  const Status checked = !asked ? Status(asked.error()) : check ? check(*asked) : Status(done);
  if (!checked) return Error{function + ": " + checked.error().message};
  return change_controls(stub, call, {function, *asked}, asked->drones());
}

}  // namespace ledgerline::chaincode
