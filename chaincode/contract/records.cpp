#include "chaincode/contract/records.hpp"

#include "common/access/grants.hpp"
#include "common/access/stops.hpp"

namespace ledgerline::chaincode {

Status write_record(Stub& stub, const std::string& key, const google::protobuf::Message& message,
                    std::uint32_t version) {
  Asset asset;
  asset.set_id(key);
  asset.set_topic("/" + key);
  asset.set_msg_type(message.GetTypeName());
  asset.set_msg_data(message.SerializeAsString());
  Stored stored = signed_by_caller(stub, {asset});
  stored.set_version(version);
  return stub.put_state(key, stored.SerializeAsString());
}

Status make_record(Stub& stub, const std::string& key, const google::protobuf::Message& message,
                   const std::string& endorsing_msp) {
  if (Status status = write_record(stub, key, message, contract::record_version); !status) return status;
  return stub.put_policy(key, endorsing_msp);
}

void insert(Names& names, const std::string& name) {
  if (contains(names, name)) return;
  names.Add(std::string(name));
  std::sort(names.begin(), names.end());
}

void erase(Names& names, const std::string& name) {
  names.erase(std::remove(names.begin(), names.end(), name), names.end());
}

namespace {

/// Who has claimed a drone is written as a stop that is none: an entry of the range that stops are read from.
Status add_stops(Stub& stub, Control& control, std::vector<Identity>* claims) {
  constexpr std::size_t step = 64;
  control.clear_stoppers();
  control.clear_cleared();
  const std::string prefix = stops_prefix(control.drone());
  std::string start = prefix;
  const std::string end = end_of(prefix);
  for (;;) {
    const auto some = stub.get_range(start, end, step);
    if (!some) return some.error();
    for (const KeyValue& entry : *some) {
      const auto stop = parse_record<Stop>(entry);
      if (!stop) return stop.error();
      if (entry.key == claim_key(control.drone(), to_name(stop->stopper()))) {
        if (claims != nullptr && !stop->cleared()) claims->push_back(stop->stopper());
      } else if (entry.key == cleared_key(control.drone(), to_name(stop->stopper()))) {
        set_clears(control, stop->stopper(), stop->clears());  // its key follows that of the stop
      } else if (!stop->cleared()) {
        add_stop(control, *stop);
      }
    }
    if (some->size() < step) return done;
    start = some->back().key + '\0';
  }
}

Status add_revoked(Stub& stub, Control& control) {
  control.clear_revoked();
  std::vector<Identity> named;
  const auto name = [&](const Identity& who) {  // each is read once
    const auto is_it = [&](const Identity& one) { return same_identity(one, who); };
    if (std::none_of(named.begin(), named.end(), is_it)) named.push_back(who);
  };
  if (control.has_holder()) name(control.holder());
  if (control.has_delegate()) name(control.delegate());
  for (const Grant& grant : control.grants()) {
    if (!grant.to().subject().empty()) name(grant.to());
  }
  for (const Identity& who : named) {
    const auto role = read_role(stub, to_name(who));
    if (!role) return role.error();
    apply_role(control, who, *role);
  }
  return done;
}

}  // namespace

Status complete(Stub& stub, Control& control, std::vector<Identity>* claims) {
  auto grants = read_record<Grants>(stub, grant_key(control.drone()));
  if (!grants) return grants.error();
  control.clear_grants();
  if (*grants) *control.mutable_grants() = std::move(*(*grants)->mutable_grants());
  auto requests = read_record<Requests>(stub, request_key(control.drone()));
  if (!requests) return requests.error();
  control.clear_requests();
  if (*requests) *control.mutable_requests() = std::move(*(*requests)->mutable_requests());
  if (Status status = add_stops(stub, control, claims); !status) return status;
  return add_revoked(stub, control);
}

Result<std::optional<ControlState>> read_control(Stub& stub, const std::string& drone) {
  auto control = read_versioned<Control>(stub, control_key(drone));
  if (!control) return control.error();
  if (!*control) return std::optional<ControlState>{};
  ControlState known{std::move(**control), {}};
  if (Status status = complete(stub, known.message, &known.claims); !status) return status.error();
  return std::optional(std::move(known));
}

Control stored_part(const Control& control) {
  Control stored = control;
  stored.clear_stoppers();
  stored.clear_cleared();
  stored.clear_grants();
  stored.clear_revoked();
  stored.clear_requests();
  return stored;
}

Status make_owner(Stub& stub, const std::string& drone, const std::string& msp_id) {
  Organisation organisation;
  organisation.set_msp_id(msp_id);
  return make_record(stub, owner_key(drone), organisation, msp_id);
}

Status write_stop(Stub& stub, const Stop& stop) {
  return write_record(stub, stop_key(stop.drone(), to_name(stop.stopper())), stop);
}

Status write_claim(Stub& stub, const std::string& drone, const Identity& claimant, bool stands) {
  Stop claim;
  claim.set_drone(drone);
  *claim.mutable_stopper() = claimant;
  claim.set_cleared(!stands);
  return write_record(stub, claim_key(drone, to_name(claimant)), claim);
}

Result<std::uint64_t> read_clears(Stub& stub, const std::string& drone, const crypto::IdentityName& stopper) {
  const auto cleared = read_record<Stop>(stub, cleared_key(drone, stopper));
  if (!cleared) return cleared.error();
  return *cleared ? (*cleared)->clears() : 0;
}

Status write_clears(Stub& stub, const std::string& drone, const StopClears& clears) {
  Stop cleared;
  cleared.set_drone(drone);
  *cleared.mutable_stopper() = clears.stopper();
  cleared.set_cleared(true);
  cleared.set_clears(clears.clears());
  return write_record(stub, cleared_key(drone, to_name(clears.stopper())), cleared);
}

}  // namespace ledgerline::chaincode
