#pragma once
#include <algorithm>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// What the calls share that say who may fly what: enroll, revoke, grant, acquire, release, request,
/// hand_over, deny, evict, stop, clear_stop, apply_stops and claim.
namespace ledgerline::chaincode {

/// Why somebody may neither fly nor stop anything, by the role that its organisation gives it.
Status check_operator(const crypto::IdentityName& who, Role role);
/// The same, with the role read for `function`.
Status check_operator(Stub& stub, const crypto::IdentityName& who, const std::string& function);
std::string revoked_text(const crypto::IdentityName& who);
std::string not_enrolled_text();
/// "Org2MSP CN=pilot, who lets Org2MSP CN=station command it": of a drone that somebody holds.
std::string holder_text(const Control& control);

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
  if (static_cast<std::size_t>(message.drones_size()) > contract::max_call_assets) {
    return Error{"the call has " + std::to_string(message.drones_size()) + " drones; the limit is " +
                 std::to_string(contract::max_call_assets)};
  }
  return message;
}

/// A list that says something of each drone of a call is empty or as long as the drones.
Status check_beside(const std::string& list, int entries, int drones);

/// In order, each once.
std::vector<std::string> sorted_names(const Names& list);

/// Sees to it that an identity's host record is of this version, and its frame is there, with their policies.
Status renew_host(Stub& stub, Records<Host>& hosts, const crypto::IdentityName& host);

/// Changes the control record of each drone. `change` changes it, or says why that is refused (without the drone's
/// name, which comes first in every refusal); it gets an epoch that is new to all of them. What is written is what
/// differs afterwards: the record, its grants, how often stops were cleared (no stop can come), and the leases that
/// follow from these; and all of a drone's records, where they are of an older version. Event and answer hold all
/// records as they now are. While somebody's claim stands, `acquire`, `request`, `hand_over` and `deny` are refused,
/// and `clear_stop` to others than the owner's organisation. A claim is over by its claimant's next `evict`, `grant` or
/// `clear_stop`, also by one that finds nothing to change.
Response change_controls(Stub& stub, const Arguments& call, const std::string& event, const Names& drones,
                         const std::function<Status(Control&, std::uint64_t new_epoch)>& change);

}  // namespace ledgerline::chaincode
