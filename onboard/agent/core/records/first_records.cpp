#include "onboard/agent/core/records/first_records.hpp"

#include <algorithm>

#include "common/access/identity.hpp"
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
      if (!role.identity().subject().empty()) records.roles.take({role.identity(), role.role()});
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

}  // namespace ledgerline::agent
