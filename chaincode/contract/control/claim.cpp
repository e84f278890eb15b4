#include <functional>

#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// claim and unclaim: the right of way for evict, grant and clear_stop, and for a holder's release. These read what
/// holders and requesters change (the lease, its requests), so a client that floods the ledger makes each of them
/// invalid.
///
/// A claim for the drone's organisation loses to nobody, as a stop does: it writes a key of its claimant's own without
/// reading it, and reads what administrators alone write. From its block on that client is refused. Its transactions in
/// flight are invalid, since they have read the range that the claim is in. A ledger has no clock, so the claim stands
/// until its claimant's next such call, or until somebody of the drone's organisation who may claim says unclaim.
///
/// A claim of the lease's holder, of whichever organisation, keeps off requests and denials alone: what they read lies
/// under a key that nothing else reads. It loses to who takes the lease, and is over with it.
///
/// What no claim keeps off are stops, which win against everything.
namespace ledgerline::chaincode {
namespace {

/// Whether the caller claims for the drone's organisation.
Result<bool> claims_for_owner(Stub& stub, const std::string& drone, Role role, Records<Host>& hosts) {
  const access::Caller caller = caller_of(stub);
  const auto organisation = read_record<Organisation>(stub, owner_key(drone));
  if (!organisation) return organisation.error();
  if (!*organisation) return Error{access::not_enrolled_text()};
  const std::string& owner = (*organisation)->msp_id();
  if (owner != caller.name.msp_id) return false;
  if (access::claims_for_owner(owner, false, caller, role)) return true;  // whose host record does not matter
  const auto host = hosts.at(host_key(caller.name));
  if (!host) return host.error();
  return access::claims_for_owner(owner, contains((*host)->drones(), drone), caller, role);
}

/// Writes the claim of the lease's holder, or that there is none.
Status write_holders_claim(Stub& stub, const std::string& drone, Role role, bool stands) {
  const auto record = read_record<Control>(stub, control_key(drone));
  if (!record) return record.error();
  if (!*record) return Error{access::not_enrolled_text()};
  if (const auto why = access::check_holders_claim(**record, caller_of(stub), role)) return Error{why->text};
  HolderClaim claim;
  if (stands) {
    *claim.mutable_holder() = (*record)->holder();
    claim.set_epoch((*record)->epoch());
  }
  return write_record(stub, holder_claim_key(drone), claim);
}

/// `write`: of one drone, by one who claims for its organisation.
Answer change_claims(Stub& stub, const Arguments& call, const std::string& function,
                     const std::function<Status(const std::string& drone)>& write) {
  const auto target = read_drones<DronesCall>(call);
  if (!target) return Error{function + ": " + target.error().message};
  const auto role = read_role(stub, stub.caller());
  if (!role) return role.error();
  Records<Host> hosts(stub);
  for (const std::string& drone : sorted_names(target->drones())) {
    Status status = check_drone_name(drone);
    if (!status) return status.error();
    const auto for_owner = claims_for_owner(stub, drone, *role, hosts);
    if (!for_owner) {
      status = for_owner.error();
    } else {
      status = *for_owner ? write(drone) : write_holders_claim(stub, drone, *role, function == contract::claim);
    }
    if (!status) return Error{drone + ": " + status.error().message};
  }
  stub.set_event(function, write_form(call, *target));
  return std::string();
}

}  // namespace

Answer claim(Stub& stub, const Arguments& call) {
  return change_claims(stub, call, contract::claim, [&](const std::string& drone) {
    return write_claim(stub, drone, to_message(stub.caller()), true);
  });
}

Answer unclaim(Stub& stub, const Arguments& call) {
  return change_claims(stub, call, contract::unclaim, [&](const std::string& drone) -> Status {
    const auto known = read_control(stub, drone);
    if (!known) return known.error();
    if (!*known) return Error{access::not_enrolled_text()};
    for (const Identity& claimant : (*known)->claims) {
      if (Status status = write_claim(stub, drone, claimant, false); !status) return status;
    }
    return write_record(stub, holder_claim_key(drone), HolderClaim());
  });
}

}  // namespace ledgerline::chaincode
