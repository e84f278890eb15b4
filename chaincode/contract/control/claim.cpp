#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// claim and unclaim: the right of way for evict, grant and clear_stop. These read what holders and requesters change
/// (the lease, its requests), so a client that floods the ledger makes each of them invalid. A claim loses to nobody,
/// as a stop does: it writes a key of its claimant's own without reading it, and reads what administrators alone write.
/// From its block on that client is refused. Its transactions in flight are invalid, since they have read the range
/// that the claim is in. A ledger has no clock, so a claim stands until its claimant's next such call, or until
/// somebody who may claim says unclaim; therefore it is the owner's organisation's alone. What it does not keep off are
/// stops, which win against everything.
namespace ledgerline::chaincode {
namespace {

Status check_claim(Stub& stub, const std::string& drone, Role role, Records<Host>& hosts) {
  const auto organisation = read_record<Organisation>(stub, owner_key(drone));
  if (!organisation) return organisation.error();
  if (!*organisation) return Error{not_enrolled_text()};
  const std::string& owner = (*organisation)->msp_id();
  if (owner == stub.caller().msp_id) {
    if (role == SUPERVISOR || stub.caller_is_admin()) return done;
    const auto host = hosts.at(host_key(stub.caller()));
    if (!host) return host.error();
    if (contains((*host)->drones(), drone)) return done;
  }
  return Error{to_text(stub.caller()) + " may not claim it: only a supervisor or administrator of " + owner +
               ", or the drone's host, may"};
}

/// `write`: of one drone.
Response change_claims(Stub& stub, const Arguments& call, const std::string& function,
                       const std::function<Status(const std::string& drone)>& write) {
  const auto target = read_drones<DronesCall>(call);
  if (!target) return refuse(function + ": " + target.error().what);
  const auto role = read_role(stub, stub.caller());
  if (!role) return refuse(role.error().what);
  if (*role == REVOKED) return refuse(function + ": " + revoked_text(stub.caller()));
  Records<Host> hosts(stub);
  for (const std::string& drone : sorted_names(target->drones())) {
    Status status = check_drone_name(drone);
    if (!status) return refuse(status.error().what);
    status = check_claim(stub, drone, *role, hosts);
    if (status) status = write(drone);
    if (!status) return refuse(drone + ": " + status.error().what);
  }
  stub.set_event(function, write_form(call, *target));
  return {};
}

}  // namespace

Response claim(Stub& stub, const Arguments& call) {
  return change_claims(stub, call, contract::claim, [&](const std::string& drone) {
    return write_claim(stub, drone, to_message(stub.caller()), true);
  });
}

Response unclaim(Stub& stub, const Arguments& call) {
  return change_claims(stub, call, contract::unclaim, [&](const std::string& drone) -> Status {
    const auto known = read_control(stub, drone);
    if (!known) return known.error();
    if (!*known) return Error{not_enrolled_text()};
    for (const Identity& claimant : (*known)->claims) {
      if (Status status = write_claim(stub, drone, claimant, false); !status) return status;
    }
    return done;
  });
}

}  // namespace ledgerline::chaincode
