#pragma once
#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "chaincode/contract/stub.hpp"
#include "common/access/access.hpp"
#include "common/crypto/crypto.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "ledgerline.pb.h"

/// What the contract's functions share: reading calls in their three forms, writing answers and events, keys, records.
namespace ledgerline::chaincode {

/// A call's arguments in one of their forms.
struct Arguments {
  enum class Form { protobuf, json, plain } form = Form::plain;
  std::string message;                                       ///< protobuf, json
  std::vector<std::string> names;                            ///< plain: ids or drones
  std::vector<std::pair<std::string, std::string>> options;  ///< plain: "key=value"

  bool json_out() const { return form != Form::protobuf; }
  /// An option's value, or `otherwise`.
  std::string option(std::string_view key, std::string otherwise) const;
};
/// The error: "the plan has 41 setpoints; the limit is 40"; `what` is "the plan has".
Status check_limit(std::string_view what, std::size_t count, std::string_view unit, std::size_t limit);
/// Of the list in a call.
inline Status check_call_size(int count, std::string_view unit) {
  return check_limit("the call has", static_cast<std::size_t>(count), unit, contract::max_call_assets);
}
Result<Arguments> read_arguments(const std::vector<std::string>& args);

/// `message` in the form of the call.
std::string write_form(const Arguments& call, const google::protobuf::Message& message);

/// An id is 1 to 128 characters of [A-Za-z0-9_./-]; no segment is empty, "." or "..".
Status check_id(const std::string& id);
/// A drone's name is one segment, no reserved word, nothing that ROS 2 needs, and no MSP id (those end with "MSP"). Of
/// a new one enroll asks contract::is_drone_name() as well.
Status check_drone_name(const std::string& name);
std::string first_segment(const std::string& id);
/// Ids that begin so are records of the contract, which it writes itself.
inline constexpr std::array<std::string_view, 12> record_kinds{
    "control", "role", "command", "lease", "host", "stop", "owner", "grant", "drones", "pilot", "request", "anchor"};

inline std::string name_hash(const crypto::IdentityName& name) {
  return crypto::hex(crypto::sha256(name.msp_id + "\n" + name.subject));
}

/// Key layout. "stream" assets of one writer live together in frame_key, all others in asset_key.
inline std::string asset_key(const std::string& id) { return "asset/" + id; }
inline std::string control_key(const std::string& drone) { return "control/" + drone; }
inline std::string owner_key(const std::string& drone) { return "owner/" + drone; }
inline std::string grant_key(const std::string& drone) { return "grant/" + drone; }
inline std::string request_key(const std::string& drone) { return "request/" + drone; }
inline std::string drones_key(const std::string& msp_id) { return "drones/" + msp_id; }
/// Read by what a holder's claim keeps off alone.
inline std::string holder_claim_key(const std::string& drone) { return request_key(drone) + "/claim"; }
/// What all of a drone's stops' and claims' keys begin with.
inline std::string stops_prefix(const std::string& drone) { return "stop/" + drone + "/"; }
inline std::string stop_key(const std::string& drone, const crypto::IdentityName& stopper) {
  return stops_prefix(drone) + name_hash(stopper);
}
inline std::string cleared_key(const std::string& drone, const crypto::IdentityName& stopper) {
  return stop_key(drone, stopper) + "/lifted";  // on ledgers since before the function was called clear_stop
}
inline std::string claim_key(const std::string& drone, const crypto::IdentityName& claimant) {
  return stop_key(drone, claimant) + "/claim";
}
/// The end of the range of all keys that begin with a prefix, which ends with "/".
inline std::string end_of(std::string prefix) {
  prefix.back() = '0';  // follows "/"
  return prefix;
}
inline std::string frame_key(const crypto::IdentityName& owner) { return "frame/" + name_hash(owner); }
inline std::string command_key(const std::string& owner_msp_id, const crypto::IdentityName& writer) {
  return "command/" + owner_msp_id + "/" + name_hash(writer);
}
inline std::string pilot_key(const std::string& owner_msp_id, const crypto::IdentityName& commander) {
  return "pilot/" + owner_msp_id + "/" + name_hash(commander);
}
inline std::string anchors_prefix(const std::string& digest) {
  return "anchor/" + crypto::hex(std::string_view(digest)) + "/";
}
inline std::string organisation_anchors_prefix(const std::string& digest, const std::string& msp_id) {
  return anchors_prefix(digest) + msp_id + "/";
}
inline std::string anchor_key(const std::string& digest, const crypto::IdentityName& signer) {
  return organisation_anchors_prefix(digest, signer.msp_id) + name_hash(signer);
}
/// As the version before kept it: a key that everybody's anchors shared.
inline std::string anchor_key_before(const std::string& digest, const crypto::IdentityName& signer) {
  return anchors_prefix(digest) + name_hash(signer);
}
inline std::string role_table_key(const std::string& msp_id, std::size_t table) {
  static_assert(contract::role_tables == 16, "a hex digit names each");
  return "role/" + msp_id + "/" + "0123456789abcdef"[table % contract::role_tables];
}
/// Below contract::role_tables.
inline std::size_t role_table_of(const crypto::IdentityName& who) {
  return crypto::sha256(who.msp_id + "\n" + who.subject)[0] >> 4U;
}
/// As the version before kept an identity's role; all of these begin with a hex digit.
inline std::string role_key_before(const crypto::IdentityName& who) { return "role/" + name_hash(who); }
inline std::string lease_key(const std::string& owner_msp_id, const crypto::IdentityName& commander,
                             std::uint64_t epoch) {
  return "lease/" + owner_msp_id + "/" + name_hash(commander) + "/" + std::to_string(epoch);
}
inline std::string host_key(const crypto::IdentityName& host) { return "host/" + name_hash(host); }

Result<std::optional<Stored>> read_stored(Stub& stub, const std::string& key);
/// Assets to store, signed with the caller's name.
Stored signed_by_caller(const Stub& stub, std::vector<Asset> assets);
Status write_stored(Stub& stub, const std::string& key, std::vector<Asset> assets, bool deleted = false);

/// What a function of the contract answers, in the form of its call; an error is its refusal.
using Answer = Result<std::string>;
/// Makes a message the transaction's event, and the answer.
std::string publish(Stub& stub, const Arguments& call, const std::string& function,
                    const google::protobuf::Message& event);

using ContractFunction = Answer(Stub& stub, const Arguments& call);
ContractFunction set_assets, delete_asset, get_assets, get_history, command, anchor, verify;
ContractFunction enroll, revoke, grant, acquire, release, request, hand_over, deny, evict;
ContractFunction stop, clear_stop, apply_stops, claim, unclaim;

}  // namespace ledgerline::chaincode
