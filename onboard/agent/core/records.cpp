#include "onboard/agent/core/records.hpp"

#include <algorithm>
#include <utility>

#include "common/access/access.hpp"
#include "common/msg/proto_json.hpp"

namespace ledgerline::agent {
namespace {

constexpr const char* control_id = "control";
constexpr const char* role_id = "role";

void add(Assets& assets, const char* id, const std::string& data) {
  Asset& asset = *assets.add_assets();
  asset.set_id(id);
  asset.set_msg_data(data);
}

}  // namespace

std::string to_bytes(const FirstRecords& records) {
  Assets assets;
  for (const Control& control : records.controls) add(assets, control_id, control.SerializeAsString());
  const verification::Organisations followed = records.roles.followed();
  for (const std::string& msp_id : followed) {  // without a subject: its roles are here, if it has some
    EnrollCall organisation;
    organisation.mutable_identity()->set_msp_id(msp_id);
    add(assets, role_id, organisation.SerializeAsString());
  }
  for (const auto& [who, role] : records.roles.all()) {
    if (!followed.contains(who.msp_id)) continue;
    EnrollCall record;
    *record.mutable_identity() = to_message(who);
    record.set_role(role);
    add(assets, role_id, record.SerializeAsString());
  }
  return assets.SerializeAsString();
}

Result<FirstRecords> records_from(std::string_view bytes, const std::vector<std::string>& drones) {
  const Error malformed{"its records cannot be read"};
  Assets assets;
  FirstRecords records;
  if (!assets.ParseFromString(std::string(bytes))) return malformed;
  for (const Asset& asset : assets.assets()) {
    Control control;
    EnrollCall role;
    if (asset.id() == control_id && control.ParseFromString(asset.msg_data())) {
      records.controls.push_back(std::move(control));
    } else if (asset.id() == role_id && role.ParseFromString(asset.msg_data())) {
      records.roles.follow(role.identity().msp_id());
      if (!role.identity().subject().empty()) records.roles.apply({role.identity(), role.role()});
    } else {
      return malformed;
    }
  }
  for (const std::string& drone : drones) {
    if (std::none_of(records.controls.begin(), records.controls.end(),
                     [&](const Control& control) { return control.drone() == drone; }))
      return Error{"it has no record of " + drone};
  }
  return records;
}

namespace {

// Who of those that a record names is revoked follows from the roles, which are compared themselves.
std::string bytes_of(Control record) {
  record.clear_revoked();
  return record.SerializeAsString();
}

std::string text_of(const Identity& who) { return who.msp_id() + " " + who.subject(); }

std::string in_short(const Control& record) {
  return (record.has_holder() ? "held by " + text_of(record.holder()) : "not held") +
         (record.has_delegate() ? ", commanded by " + text_of(record.delegate()) : "") + ", epoch " +
         std::to_string(record.epoch()) + ", " + std::to_string(record.stoppers_size()) + " stops, " +
         std::to_string(record.grants_size()) + " grants";
}

// An identity without a role and one that is not known may do the same. Of organisations that one of the two does not
// follow, or has left out, nothing is compared.
std::map<crypto::IdentityName, Role> roles_in_both(const verification::RolesByOrganisation& roles,
                                                   const verification::RolesByOrganisation& others) {
  std::map<crypto::IdentityName, Role> out = roles.all();
  const auto followed = roles.followed(), followed_there = others.followed();
  std::erase_if(out, [&](const auto& one) {
    const std::string& msp_id = one.first.msp_id;
    return one.second == ROLE_NONE || !followed.contains(msp_id) || !followed_there.contains(msp_id) ||
           roles.left_out().contains(msp_id) || others.left_out().contains(msp_id);
  });
  return out;
}

std::string text_of(const std::map<crypto::IdentityName, Role>& roles) {
  std::string text;
  for (const auto& [who, role] : roles) text += who.msp_id + " " + who.subject + " " + Role_Name(role) + "\n";
  return text;
}

}  // namespace

void SecondOpinion::compare(const Difference& in_short, ComparedRecord now, Comparison& comparison) {
  const auto known = different_.find(in_short.what);
  if (now.ours == now.theirs) {
    if (known == different_.end()) return;
    if (known->second.reported) comparison.cleared.push_back(in_short.what);
    different_.erase(known);
    return;
  }
  if (known == different_.end()) {
    different_.emplace(in_short.what, std::move(now));
    comparison.again_soon = true;
    return;
  }
  ComparedRecord& before = known->second;
  if (before.reported) return;
  if (before.ours == now.ours && before.theirs == now.theirs) {
    before.reported = true;
    ++alarms_;
    comparison.alarms.push_back(in_short);
    return;
  }
  before = std::move(now);
  comparison.again_soon = true;
}

std::vector<SecondOpinion::Pair> SecondOpinion::pairs(const FirstRecords& ours, const FirstRecords& theirs) {
  std::vector<Pair> pairs;
  for (const Control& control : ours.controls) {
    const auto reported = std::find_if(theirs.controls.begin(), theirs.controls.end(),
                                       [&](const Control& one) { return one.drone() == control.drone(); });
    const bool there = reported != theirs.controls.end();
    pairs.push_back({{control.drone(), in_short(control), there ? in_short(*reported) : "no record"},
                     {bytes_of(control), there ? bytes_of(*reported) : ""}});
  }
  const auto our_roles = roles_in_both(ours.roles, theirs.roles), their_roles = roles_in_both(theirs.roles, ours.roles);
  pairs.push_back(
      {{"roles", std::to_string(our_roles.size()) + " of them", std::to_string(their_roles.size()) + " of them"},
       {text_of(our_roles), text_of(their_roles)}});
  return pairs;
}

SecondOpinion::Comparison SecondOpinion::compare(const FirstRecords& ours, const FirstRecords& theirs) {
  ++compared_;
  Comparison comparison;
  for (Pair& pair : pairs(ours, theirs)) compare(pair.in_short, std::move(pair.records), comparison);
  return comparison;
}

std::vector<SecondOpinion::Difference> SecondOpinion::differences(const FirstRecords& ours,
                                                                  const FirstRecords& theirs) {
  std::vector<Difference> different;
  for (Pair& pair : pairs(ours, theirs)) {
    if (pair.records.ours != pair.records.theirs) different.push_back(std::move(pair.in_short));
  }
  return different;
}

bool SecondOpinion::differs() const {
  return std::any_of(different_.begin(), different_.end(), [](const auto& one) { return one.second.reported; });
}

}  // namespace ledgerline::agent
