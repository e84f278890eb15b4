#include "chaincode/contract/control/control_calls.hpp"

#include <set>
#include <utility>

#include "common/access/grants.hpp"
#include "common/access/stops.hpp"

namespace ledgerline::chaincode {
namespace {

/// Sees to it that the key is there which this commander's commands write, before the first of them.
Status make_pilot(Stub& stub, const std::string& endorsing_msp, const crypto::IdentityName& commander) {
  const std::string key = pilot_key(endorsing_msp, commander);
  const auto known = read_stored(stub, key);  // not the commands' own key: each of them would make this call invalid
  if (!known || *known) return known ? Status(done) : known.error();
  Organisation organisation;
  organisation.set_msp_id(endorsing_msp);
  if (Status status = make_record(stub, key, organisation, endorsing_msp); !status) return status;
  return make_record(stub, command_key(endorsing_msp, commander), CommandCall(), endorsing_msp);
}

/// Keeps the leases true to a control record that has changed. Holders who let the same one command may share a lease's
/// record; what it says is said of each drone alone. `new_pilots`: who may command because of this change, by endorsing
/// MSP.
Status follow(Records<Lease>& leases, const Control& before, const Control& after,
              std::set<std::pair<std::string, crypto::IdentityName>>& new_pilots) {
  const auto key = [](const Control& control) {
    return control.has_holder() ? lease_key(control.owner().msp_id(), to_name(commander_of(control)), control.epoch())
                                : std::string();
  };
  const std::string& endorsing_msp = after.owner().msp_id();
  const std::string from = key(before), to = key(after);
  if (!from.empty() && from != to) {
    const auto lease = leases.at(from, endorsing_msp);
    if (!lease) return lease.error();
    erase(*(*lease)->mutable_drones(), before.drone());
    erase(*(*lease)->mutable_stopped(), before.drone());
  }
  if (to.empty()) return done;
  const auto lease = leases.at(to, endorsing_msp);
  if (!lease) return lease.error();
  insert(*(*lease)->mutable_drones(), after.drone());
  (is_stopped(after) ? insert : erase)(*(*lease)->mutable_stopped(), after.drone());
  if (!leases.was_there(to)) new_pilots.emplace(endorsing_msp, to_name(commander_of(after)));
  return done;
}

/// Writes what `change` made of a drone's records: those that differ, or all of them where they are of an older
/// version.
Status write_changes(Stub& stub, const Control& before, const Control& after, std::uint32_t version) {
  const std::string &drone = after.drone(), &endorsing_msp = after.owner().msp_id();
  const bool old = version < contract::record_version;
  const auto write = [&](const std::string& key, const auto& was, const auto& now) -> Status {
    if (old) return make_record(stub, key, now, endorsing_msp);
    if (was.SerializeAsString() == now.SerializeAsString()) return done;
    return write_record(stub, key, now, contract::record_version);
  };
  Grants old_grants, grants;
  *old_grants.mutable_grants() = before.grants();
  *grants.mutable_grants() = after.grants();
  Requests old_requests, requests;
  *old_requests.mutable_requests() = before.requests();
  *requests.mutable_requests() = after.requests();
  Status status = write(control_key(drone), stored_part(before), stored_part(after));
  if (status) status = write(grant_key(drone), old_grants, grants);
  if (status) status = write(request_key(drone), old_requests, requests);
  if (status && old) status = make_owner(stub, drone, endorsing_msp);
  if (!status) return status;
  for (const StopClears& cleared : after.cleared()) {
    if (clears_of(before, cleared.stopper()) == cleared.clears()) continue;
    if (status = write_clears(stub, drone, cleared); !status) return status;
  }
  return done;
}

bool is_among(const std::vector<Identity>& all, const crypto::IdentityName& who) {
  return std::ranges::any_of(all, [&](const Identity& one) { return to_name(one) == who; });
}

/// Why the call has to wait for those who have claimed the drone. A holder's claim is read by those alone that it keeps
/// off: a holder who claims all the time makes nothing else invalid.
Result<std::optional<access::Refusal>> check_claims(Stub& stub, const ControlState& known, const std::string& function,
                                                    const access::Caller& caller) {
  if (auto why = access::check_claimed(known.claims, known.message, function, caller)) return why;
  if (!access::waits_for_holder(function)) return std::optional<access::Refusal>();
  const auto claim = read_record<HolderClaim>(stub, holder_claim_key(known.message.drone()));
  if (!claim) return claim.error();
  return *claim ? access::check_claimed(**claim, known.message, function, caller) : std::nullopt;
}

/// Ends the caller's own claim, by one of the calls that claims are for. False: it has none.
Result<bool> end_claim(Stub& stub, const ControlState& known, const std::string& function) {
  if (!is_among(known.claims, stub.caller()) || !contract::is_claimed_for(function)) return false;
  const Status status = write_claim(stub, known.message.drone(), to_message(stub.caller()), false);
  return status ? Result<bool>(true) : Result<bool>(status.error());
}

/// The same for the claim of the lease's holder, where that is who calls. A release ends it with the lease.
Status end_holders_claim(Stub& stub, const Control& before, const std::string& function) {
  const bool is_holder = before.has_holder() && to_name(before.holder()) == stub.caller();
  if (!is_holder || function == contract::release || !contract::is_claimed_for(function)) return done;
  const auto claim = read_record<HolderClaim>(stub, holder_claim_key(before.drone()));
  if (!claim) return claim.error();
  if (!*claim || !(*claim)->has_holder()) return done;
  return write_record(stub, holder_claim_key(before.drone()), HolderClaim());
}

/// Whether the holder or the stops that a call is to end are gone already.
bool has_nothing_to_do(const Control& control, const std::string& function) {
  return (function == contract::evict && !control.has_holder()) ||
         (function == contract::clear_stop && !is_stopped(control));
}

/// Of those whose roles are not there yet.
Status read_roles(Stub& stub, const std::vector<crypto::IdentityName>& whose, access::Roles& roles) {
  for (const crypto::IdentityName& who : whose) {
    if (roles.known.contains(who)) continue;
    const auto role = read_role(stub, who);
    if (!role) return role.error();
    roles.known.emplace(who, *role);
  }
  return done;
}

}  // namespace

access::Caller caller_of(const Stub& stub) { return {stub.caller(), stub.caller_is_admin()}; }

Status check_length(const std::string& field, const Identity& who) {
  for (const std::string& part : {who.msp_id(), who.subject()}) {
    if (Status status = check_limit(field + " has", part.size(), "characters", contract::max_subject_chars); !status)
      return status;
  }
  return done;
}

Status check_identity(const std::string& field, const Identity& who) {
  if (who.msp_id().empty() || who.subject().empty()) return Error{field + " needs mspId and subject"};
  return check_length(field, who);
}

Status check_beside(const std::string& list, int entries, int drones) {
  if (entries == 0 || entries == drones) return done;
  return Error{std::to_string(entries) + " " + list + " for " + std::to_string(drones) + " drones"};
}

std::vector<std::string> sorted_names(const Names& list) {
  std::vector<std::string> names(list.begin(), list.end());
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

Status renew_host(Stub& stub, Records<Host>& hosts, const crypto::IdentityName& host) {
  const std::string key = host_key(host);
  const auto record = hosts.at(key, host.msp_id);
  if (!record) return record.error();
  const bool begins = !hosts.was_there(key) && !(*record)->drones().empty();
  if (!begins && !hosts.is_old(key)) return done;
  const auto frame = read_stored(stub, frame_key(host));
  if (!frame) return frame.error();
  if (!*frame) {
    if (Status status = write_stored(stub, frame_key(host), {}); !status) return status;
  }
  return stub.put_policy(frame_key(host), host.msp_id);
}

Answer change_controls(Stub& stub, const Arguments& call, const access::Call& asked, const Names& drones) {
  const access::Caller caller = caller_of(stub);
  access::RuleInputs inputs{.roles = {.all = true}, .new_epoch = 1};
  if (Status status = read_roles(stub, access::roles_needed(asked, caller), inputs.roles); !status)
    return status.error();
  if (const auto why = access::check_call(asked, caller, inputs.roles)) return Error{asked.function + ": " + why->text};
  std::vector<ControlState> known;
  for (const std::string& drone : sorted_names(drones)) {
    if (Status status = check_drone_name(drone); !status) return status.error();
    auto control = read_control(stub, drone);
    if (!control) return control.error();
    if (!*control) return Error{drone + ": " + access::not_enrolled_text()};
    const Control& before = (*control)->message;
    const auto claimed = check_claims(stub, **control, asked.function, caller);
    if (!claimed) return claimed.error();
    if (*claimed) return Error{drone + ": " + (*claimed)->text};
    if (Status status = read_roles(stub, access::roles_needed(asked, before), inputs.roles); !status)
      return status.error();
    inputs.new_epoch = std::max(inputs.new_epoch, before.epoch() + 1);
    known.push_back(std::move(**control));
  }
  Controls all;
  Records<Lease> leases(stub);
  std::set<std::pair<std::string, crypto::IdentityName>> new_pilots;
  for (const ControlState& before : known) {
    const auto ends_own = end_claim(stub, before, asked.function);
    if (!ends_own) return ends_own.error();
    if (Status status = end_holders_claim(stub, before.message, asked.function); !status) return status.error();
    Control control = before.message;
    if (!*ends_own || !has_nothing_to_do(before.message, asked.function)) {
      auto after = access::apply(before.message, asked, caller, inputs);
      if (const auto* why = std::get_if<access::Refusal>(&after)) return Error{control.drone() + ": " + why->text};
      control = std::get<Control>(std::move(after));
    }
    if (Status status = write_changes(stub, before.message, control, before.version); !status) return status.error();
    if (Status status = follow(leases, before.message, control, new_pilots); !status) return status.error();
    *all.add_controls() = std::move(control);
  }
  for (const auto& [endorsing_msp, commander] : new_pilots) {
    if (Status status = make_pilot(stub, endorsing_msp, commander); !status) return status.error();
  }
  if (Status status = leases.write(); !status) return status.error();
  return publish(stub, call, asked.function, all);
}

}  // namespace ledgerline::chaincode
