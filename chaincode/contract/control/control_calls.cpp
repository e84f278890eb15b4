#include "chaincode/contract/control/control_calls.hpp"

#include "common/msg/stops.hpp"

namespace ledgerline::chaincode {
namespace {

/// Keeps the leases true to a control record that has changed.
Status follow(Records<Lease>& leases, const Control& before, const Control& after) {
  const auto key = [](const Control& control) {
    return control.has_holder() ? lease_key(to_name(control.holder()), control.epoch()) : std::string();
  };
  const std::string from = key(before), to = key(after);
  if (!from.empty() && from != to) {
    const auto lease = leases.at(from);
    if (!lease) return lease.error();
    erase(*(*lease)->mutable_drones(), before.drone());
    erase(*(*lease)->mutable_stopped(), before.drone());
  }
  if (to.empty()) return done;
  const auto lease = leases.at(to);
  if (!lease) return lease.error();
  insert(*(*lease)->mutable_drones(), after.drone());
  (is_stopped(after) ? insert : erase)(*(*lease)->mutable_stopped(), after.drone());
  return done;
}

template <typename Message>
Status write_if_changed(Stub& stub, const std::string& key, const Message& before, const Message& after) {
  return before.SerializeAsString() == after.SerializeAsString() ? done : write_record(stub, key, after);
}

Grants grants_of(const Control& control) {
  Grants grants;
  *grants.mutable_grants() = control.grants();
  return grants;
}

Requests requests_of(const Control& control) {
  Requests requests;
  *requests.mutable_requests() = control.requests();
  return requests;
}

/// Writes what `change` made of a control record.
Status write_changes(Stub& stub, const Control& before, const Control& after) {
  const std::string& drone = after.drone();
  Status status = write_if_changed(stub, control_key(drone), stored_part(before), stored_part(after));
  if (status) status = write_if_changed(stub, grant_key(drone), grants_of(before), grants_of(after));
  if (status) status = write_if_changed(stub, request_key(drone), requests_of(before), requests_of(after));
  if (!status) return status;
  for (Stop stop : before.stoppers()) {
    Control rest = after;
    if (remove_stop(rest, stop.stopper())) continue;
    stop.set_lifted(true);
    if (status = write_stop(stub, stop); !status) return status;
  }
  return done;
}

}  // namespace

std::string revoked_text(const crypto::IdentityName& who) {
  return to_text(who) + " is revoked; an administrator of " + who.msp_id + " may enroll it anew";
}

Status check_operator(const crypto::IdentityName& who, Role role) {
  if (role == OPERATOR || role == SUPERVISOR) return done;
  if (role == REVOKED) return Error{revoked_text(who)};
  return Error{to_text(who) + " is neither operator nor supervisor; an administrator of " + who.msp_id +
               " may enroll it as one"};
}

Status check_operator(Stub& stub, const crypto::IdentityName& who, const std::string& function) {
  const auto role = read_role(stub, who);
  if (!role) return role.error();
  if (Status status = check_operator(who, *role); !status) return Error{function + ": " + status.error().what};
  return done;
}

std::vector<std::string> sorted_names(const Names& list) {
  std::vector<std::string> names(list.begin(), list.end());
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

Response change_controls(Stub& stub, const Arguments& call, const std::string& event, const Names& drones,
                         const std::function<Status(Control&, std::uint64_t new_epoch)>& change) {
  Controls all;
  std::uint64_t new_epoch = 1;
  for (const std::string& drone : sorted_names(drones)) {
    if (Status status = check_drone_name(drone); !status) return refuse(status.error().what);
    auto control = read_control(stub, drone);
    if (!control) return refuse(control.error().what);
    if (!*control) return refuse(drone + ": not enrolled");
    new_epoch = std::max(new_epoch, (*control)->epoch() + 1);
    *all.add_controls() = std::move(**control);
  }
  Records<Lease> leases(stub);
  for (Control& control : *all.mutable_controls()) {
    const Control before = control;
    if (Status status = change(control, new_epoch); !status) {
      return refuse(control.drone() + ": " + status.error().what);
    }
    if (Status status = write_changes(stub, before, control); !status) return refuse(status.error().what);
    if (Status status = follow(leases, before, control); !status) return refuse(status.error().what);
  }
  if (Status status = leases.write(); !status) return refuse(status.error().what);
  const std::string payload = write_form(call, all);
  stub.set_event(event, payload);
  return {200, {}, payload};
}

}  // namespace ledgerline::chaincode
