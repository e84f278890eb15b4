#include "chaincode/contract/control/control_calls.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// stop, clear_stop and apply_stops. A stop must lose to nobody: it writes a key of its stopper's own without reading
/// it, and reads what administrators alone write, and how often its stopper's own stops were cleared. So a stop
/// endorsed before a clear of its stopper's stops, and ordered behind it, is invalid. Commands of the lease are refused
/// from the host's apply_stops on.
namespace ledgerline::chaincode {
namespace {

/// What administrators alone write of a drone's record: owner and grants, so that nobody can make a stop invalid by
/// flying, acquiring or releasing.
Result<Control> read_for_stop(Stub& stub, const std::string& drone) {
  const auto organisation = read_record<Organisation>(stub, owner_key(drone));
  if (!organisation) return organisation.error();
  if (!*organisation) return Error{access::not_enrolled_text()};
  Control record;
  record.set_drone(drone);
  record.mutable_owner()->set_msp_id((*organisation)->msp_id());
  if ((*organisation)->msp_id() == stub.caller().msp_id) return record;  // who needs no grant
  const auto grants = read_record<Grants>(stub, grant_key(drone));
  if (!grants) return grants.error();
  if (*grants) *record.mutable_grants() = (*grants)->grants();
  return record;
}

/// Reads how often the caller's stops of this drone were cleared, and why the caller may not stop it.
Result<std::uint64_t> check_stop(Stub& stub, const std::string& drone, const DronesCall& call, Role role) {
  const access::Caller caller = caller_of(stub);
  const auto record = read_for_stop(stub, drone);
  if (!record) return record.error();
  if (const auto why = access::check_stop(*record, caller, role, call.cut())) return Error{why->text};
  const auto clears = read_clears(stub, drone, caller.name);
  if (!clears) return clears;
  if (const auto why = access::check_clears(call, drone, caller, *clears)) return Error{why->text};
  return clears;
}

}  // namespace

Answer stop(Stub& stub, const Arguments& call) {
  auto target = read_drones<DronesCall>(call);
  if (!target) return Error{"stop: " + target.error().message};
  const std::string option = call.option("cut", "");
  if (!option.empty() && option != "true" && option != "false") return Error{"stop: cut must be true or false"};
  if (option == "true") target->set_cut(true);
  if (Status status = check_beside("clears", target->clears_size(), target->drones_size()); !status)
    return Error{"stop: " + status.error().message};
  const auto role = read_role(stub, stub.caller());
  if (!role) return role.error();

  Stops all;
  for (const std::string& drone : sorted_names(target->drones())) {
    if (Status status = check_drone_name(drone); !status) return status.error();
    const auto clears = check_stop(stub, drone, *target, *role);
    if (!clears) return Error{drone + ": " + clears.error().message};
    Stop& one = *all.add_stops();
    one.set_drone(drone);
    *one.mutable_stopper() = to_message(stub.caller());
    one.set_cut(target->cut());
    one.set_clears(*clears);
    if (Status status = write_stop(stub, one); !status) return status.error();
  }
  return publish(stub, call, contract::stop, all);
}

Answer clear_stop(Stub& stub, const Arguments& call) {
  return change_drones<DronesCall>(stub, call, contract::clear_stop);
}

Answer apply_stops(Stub& stub, const Arguments& call) {
  const auto target = read_drones<DronesCall>(call);
  if (!target) return Error{"apply_stops: " + target.error().message};
  Records<Host> hosts(stub);
  Status renewed = renew_host(stub, hosts, stub.caller());
  if (renewed) renewed = hosts.write();
  if (!renewed) return renewed.error();
  return change_controls(stub, call, {contract::apply_stops, *target}, target->drones());
}

}  // namespace ledgerline::chaincode
