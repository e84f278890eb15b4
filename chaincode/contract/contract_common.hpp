#pragma once
#include <array>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "chaincode/contract/stub.hpp"
#include "common/access/identity.hpp"
#include "common/base/text.hpp"
#include "common/msg/proto_json.hpp"
#include "ledgerline.pb.h"

/// What the contract's functions share: reading calls in their three forms, writing answers and events, keys, records.
namespace ledgerline::chaincode {

/// Refusals quote the call, which may hold anything; they go into text fields, headers and terminals.
inline Response refuse(const std::string& why) { return {500, printable(why), {}}; }

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
Result<Arguments> read_arguments(const std::vector<std::string>& args);

/// `message` in the form of the call.
std::string write_form(const Arguments& call, const google::protobuf::Message& message);
/// The same for a list of assets; `single` chooses JSON's form of one asset.
std::string write_assets(const Arguments& call, const Assets& assets, bool single);

/// An id is 1 to 128 characters of [A-Za-z0-9_./-]; no segment is empty, "." or "..".
Status check_id(const std::string& id);
/// A drone's name is one segment, no reserved word, nothing that ROS 2 needs, and no MSP id (those end with "MSP").
Status check_drone_name(const std::string& name);
std::string first_segment(const std::string& id);
/// Ids that begin so are records of the contract, which it writes itself.
inline constexpr std::array<std::string_view, 12> record_kinds{
    "control", "role", "command", "lease", "host", "stop", "owner", "grant", "drones", "pilot", "request", "anchor"};

/// Key layout. "stream" assets of one writer live together in frame_key, all others in asset_key.
std::string asset_key(const std::string& id);
std::string control_key(const std::string& drone);
std::string owner_key(const std::string& drone);
std::string grant_key(const std::string& drone);
std::string request_key(const std::string& drone);
std::string drones_key(const std::string& msp_id);
std::string stop_key(const std::string& drone, const crypto::IdentityName& stopper);
std::string cleared_key(const std::string& drone, const crypto::IdentityName& stopper);
std::string claim_key(const std::string& drone, const crypto::IdentityName& claimant);
std::string holder_claim_key(const std::string& drone);  ///< read by what a holder's claim keeps off alone
std::string stops_prefix(const std::string& drone);      ///< what all of its stops' and claims' keys begin with
/// The end of the range of all keys that begin with a prefix, which ends with "/".
std::string end_of(std::string prefix);
std::string frame_key(const crypto::IdentityName& owner);
std::string command_key(const std::string& owner_msp_id, const crypto::IdentityName& writer);
std::string pilot_key(const std::string& owner_msp_id, const crypto::IdentityName& commander);
std::string anchors_prefix(const std::string& digest);
std::string organisation_anchors_prefix(const std::string& digest, const std::string& msp_id);
std::string anchor_key(const std::string& digest, const crypto::IdentityName& signer);
/// As the version before kept it: a key that everybody's anchors shared.
std::string anchor_key_before(const std::string& digest, const crypto::IdentityName& signer);
std::string role_table_key(const std::string& msp_id, std::size_t table);
std::size_t role_table_of(const crypto::IdentityName& who);  ///< below contract::role_tables
/// As the version before kept an identity's role; all of these begin with a hex digit.
std::string role_key_before(const crypto::IdentityName& who);
std::string lease_key(const std::string& owner_msp_id, const crypto::IdentityName& commander, std::uint64_t epoch);
std::string host_key(const crypto::IdentityName& host);

Result<std::optional<Stored>> read_stored(Stub& stub, const std::string& key);
/// Assets to store, signed with the caller's name.
Stored signed_by_caller(const Stub& stub, std::vector<Asset> assets);
Status write_stored(Stub& stub, const std::string& key, std::vector<Asset> assets, bool deleted = false);

Response set_assets(Stub& stub, const Arguments& call);
Response delete_asset(Stub& stub, const Arguments& call);
Response get_assets(Stub& stub, const Arguments& call);
Response get_history(Stub& stub, const Arguments& call);
Response enroll(Stub& stub, const Arguments& call);
Response revoke(Stub& stub, const Arguments& call);
Response grant(Stub& stub, const Arguments& call);
Response acquire(Stub& stub, const Arguments& call);
Response release(Stub& stub, const Arguments& call);
Response request(Stub& stub, const Arguments& call);
Response hand_over(Stub& stub, const Arguments& call);
Response deny(Stub& stub, const Arguments& call);
Response evict(Stub& stub, const Arguments& call);
Response command(Stub& stub, const Arguments& call);
Response stop(Stub& stub, const Arguments& call);
Response clear_stop(Stub& stub, const Arguments& call);
Response apply_stops(Stub& stub, const Arguments& call);
Response claim(Stub& stub, const Arguments& call);
Response unclaim(Stub& stub, const Arguments& call);
Response anchor(Stub& stub, const Arguments& call);
Response verify(Stub& stub, const Arguments& call);

}  // namespace ledgerline::chaincode
