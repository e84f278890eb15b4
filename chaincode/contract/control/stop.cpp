#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/grants.hpp"
#include "common/msg/stops.hpp"

/// stop, clear_stop and apply_stops. A stop must lose to nobody: it writes a key of its stopper's own without reading
/// it, and reads what administrators alone write, and how often its stopper's own stops were cleared. So it is invalid
/// where one of them was cleared behind its endorsement, and never again: no more of them stands. Held back until then,
/// it would stop a drone whose stop was cleared. Commands of the lease are refused from the host's apply_stops on.
namespace ledgerline::chaincode {
namespace {

/// Why the caller may not stop this drone. Only administrators write role, organisation and grants, so nobody can make
/// a stop invalid by flying, acquiring or releasing.
Status check_stop(Stub& stub, const std::string& drone, Role role, bool cut) {
  const auto organisation = read_record<Organisation>(stub, owner_key(drone));
  if (!organisation) return organisation.error();
  if (!*organisation) return Error{not_enrolled_text()};
  const std::string& owner = (*organisation)->msp_id();
  if (Status status = check_operator(stub.caller(), role); !status) return status;
  if (owner == stub.caller().msp_id) return done;
  const auto grants = read_record<Grants>(stub, grant_key(drone));
  if (!grants) return grants.error();
  const Rights rights = rights_of((*grants ? **grants : Grants()).grants(), owner, to_message(stub.caller()));
  if (cut ? rights.cut : rights.stop) return done;
  return Error{to_text(stub.caller()) + " may not " + (cut ? "cut" : "stop") + " it: " + owner +
               " has granted that neither to this identity nor to " + stub.caller().msp_id + "; an administrator of " +
               owner + " may"};
}

}  // namespace

Response stop(Stub& stub, const Arguments& call) {
  auto target = read_drones<DronesCall>(call);
  if (!target) return refuse("stop: " + target.error().what);
  const std::string option = call.option("cut", "");
  if (!option.empty() && option != "true" && option != "false") return refuse("stop: cut must be true or false");
  if (option == "true") target->set_cut(true);
  if (Status status = check_beside("clears", target->clears_size(), target->drones_size()); !status)
    return refuse("stop: " + status.error().what);
  const auto role = read_role(stub, stub.caller());
  if (!role) return refuse(role.error().what);

  Stops all;
  for (const std::string& drone : sorted_names(target->drones())) {
    if (Status status = check_drone_name(drone); !status) return refuse(status.error().what);
    if (Status status = check_stop(stub, drone, *role, target->cut()); !status) {
      return refuse(drone + ": " + status.error().what);
    }
    const auto clears = read_clears(stub, drone, stub.caller());
    if (!clears) return refuse(clears.error().what);
    const auto meant = said_of(*target, target->clears(), drone);
    if (meant && *meant != *clears) {
      return refuse(drone + ": a stop meant for " + std::to_string(*meant) + " clears of the stops of " +
                    to_text(stub.caller()) + "; the ledger has " + std::to_string(*clears) + ": name that, or none");
    }
    Stop& one = *all.add_stops();
    one.set_drone(drone);
    *one.mutable_stopper() = to_message(stub.caller());
    one.set_cut(target->cut());
    one.set_clears(*clears);
    if (Status status = write_stop(stub, one); !status) return refuse(status.error().what);
  }
  const std::string payload = write_form(call, all);
  stub.set_event(contract::stop, payload);
  return {200, {}, payload};
}

Response clear_stop(Stub& stub, const Arguments& call) {
  const auto target = read_drones<DronesCall>(call);
  if (!target) return refuse("clear_stop: " + target.error().what);
  const auto role = read_role(stub, stub.caller());
  if (!role) return refuse(role.error().what);
  if (*role == REVOKED) return refuse("clear_stop: " + revoked_text(stub.caller()));

  return change_controls(
      stub, call, contract::clear_stop, target->drones(), [&](Control& control, std::uint64_t) -> Status {
        if (!is_stopped(control))
          return Error{"not stopped; there is nothing that " + to_text(stub.caller()) + " could clear"};
        if (clear_stops(control, to_message(stub.caller()), *role == SUPERVISOR)) return done;
        return Error{"stopped by " + stopper_names(control) + "; only they, each its own, or a supervisor of " +
                     control.owner().msp_id() + " may clear it"};
      });
}

Response apply_stops(Stub& stub, const Arguments& call) {
  const auto target = read_drones<DronesCall>(call);
  if (!target) return refuse("apply_stops: " + target.error().what);
  Records<Host> hosts(stub);
  Status renewed = renew_host(stub, hosts, stub.caller());
  if (renewed) renewed = hosts.write();
  if (!renewed) return refuse(renewed.error().what);
  return change_controls(
      stub, call, contract::apply_stops, target->drones(), [&](Control& control, std::uint64_t new_epoch) -> Status {
        if (to_name(control.owner()) != stub.caller()) {
          return Error{"enrolled to " + to_text(to_name(control.owner())) + ", who alone applies its stops"};
        }
        end_revoked(control, new_epoch);
        return done;
      });
}

}  // namespace ledgerline::chaincode
