#include "chaincode/records.hpp"

namespace ledgerline::chaincode {

Status write_record(Stub& stub, const std::string& key, const google::protobuf::Message& message) {
  Asset asset;
  asset.set_id(key);
  asset.set_topic("/" + key);
  asset.set_msg_type(message.GetTypeName());
  asset.set_msg_data(message.SerializeAsString());
  return write_stored(stub, key, {asset});
}

void insert(Names& names, const std::string& name) {
  if (contains(names, name)) return;
  names.Add(std::string(name));
  std::sort(names.begin(), names.end());
}

void erase(Names& names, const std::string& name) {
  names.erase(std::remove(names.begin(), names.end(), name), names.end());
}

Result<std::optional<Control>> read_control(Stub& stub, const std::string& drone) {
  return read_record<Control>(stub, control_key(drone));
}

Status write_control(Stub& stub, const Control& control) {
  return write_record(stub, control_key(control.drone()), control);
}

Result<Role> read_role(Stub& stub, const crypto::IdentityName& who) {
  const auto record = read_record<EnrollCall>(stub, role_key(who));
  if (!record) return record.error();
  return *record ? (*record)->role() : ROLE_NONE;
}

}  // namespace ledgerline::chaincode
