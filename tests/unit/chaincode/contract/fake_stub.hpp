#pragma once
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "chaincode/contract/stub.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/proto_json.hpp"
#include "ledgerline.pb.h"
#include "tests/unit/chaincode/command_call.hpp"

namespace ledgerline::chaincode {

/// A ledger of one: what a call wrote becomes visible when it succeeded, as after its commit.
class FakeStub : public Stub {
 public:
  Result<std::optional<std::string>> get_state(const std::string& key) override {
    reads.push_back(key);
    const auto found = state.find(key);
    if (found == state.end()) return std::optional<std::string>{};
    return std::optional(found->second);
  }
  Status put_state(const std::string& key, const std::string& value) override {
    writes[key] = value;
    return done;
  }
  Status put_policy(const std::string& key, const std::string& msp_id) override {
    EXPECT_TRUE(writes.contains(key) || state.contains(key)) << key;
    new_policies[key] = msp_id;
    return done;
  }
  Result<std::vector<KeyValue>> get_range(const std::string& start, const std::string& end,
                                          std::size_t limit) override {
    ranges.push_back(start);
    std::vector<KeyValue> found;
    for (auto it = state.lower_bound(start); it != state.end() && it->first < end && found.size() < limit; ++it) {
      found.push_back({it->first, it->second});
    }
    return found;
  }
  Result<std::vector<KeyVersion>> get_history(const std::string& key, std::size_t skip, std::size_t limit) override {
    if (!has_history) return Error{"history database not enabled"};
    std::vector<KeyVersion> found;
    const auto& all = history[key];
    for (std::size_t i = skip; i < all.size() && found.size() < limit; ++i) found.push_back(all[all.size() - 1 - i]);
    looked += found.size();
    return found;
  }
  void set_event(const std::string& name, const std::string& payload) override {
    event_name = name;
    event_payload = payload;
  }
  const crypto::IdentityName& caller() const override { return who; }
  bool caller_is_admin() const override { return who.subject.rfind("CN=Admin", 0) == 0; }

  Response call(const crypto::IdentityName& by, const std::string& function, const std::vector<std::string>& args) {
    who = by;
    reads.clear();
    ranges.clear();
    writes.clear();
    new_policies.clear();
    event_name.clear();
    event_payload.clear();
    Response response = invoke(*this, function, args);
    if (response.status < 400) {
      ++transactions;
      for (const auto& [key, msp_id] : new_policies) policies[key] = msp_id;
      for (const auto& [key, value] : writes) {
        state[key] = value;
        history[key].push_back({"tx" + std::to_string(transactions), transactions, value});
      }
    }
    return response;
  }
  Response call(const crypto::IdentityName& by, const std::string& function, const google::protobuf::Message& message) {
    return call(by, function, {message.SerializeAsString()});
  }

  std::map<std::string, std::string> state, writes;
  std::map<std::string, std::string> policies, new_policies;  ///< MSP id that endorses a key
  std::map<std::string, std::vector<KeyVersion>> history;
  std::vector<std::string> reads, ranges;  ///< keys, and where ranges begin
  std::string event_name, event_payload;
  bool has_history = true;
  TimeNs transactions = 0;
  std::size_t looked = 0;  ///< old versions that were handed out
  crypto::IdentityName who;
};

template <typename Message>
Message parsed(const std::string& bytes) {
  Message message;
  EXPECT_TRUE(parse_message(bytes, message).ok()) << bytes;
  return message;
}

/// tello1 and tello2 belong to Org1's host and are granted to Org2, all of it; pilot and rival are operators of Org2,
/// chief is a supervisor of Org1.
class ContractTest : public ::testing::Test {
 protected:
  ContractTest() {
    enroll(admin1, host, {"tello1", "tello2"}, ROLE_NONE);
    enroll(admin2, pilot, {}, OPERATOR);
    enroll(admin2, rival, {}, OPERATOR);
    enroll(admin1, chief, {}, SUPERVISOR);
    enroll(admin1, guard, {}, OPERATOR);
    grant(admin1, {"tello1", "tello2"}, "Org2MSP", "", true, true);
  }

  /// What an organisation, or one of its identities, may do; `fly` at any priority, or at those up to `max_priority`.
  Response grant(const crypto::IdentityName& by, const std::vector<std::string>& drones, const std::string& msp_id,
                 const std::string& subject, bool fly, bool cut = false,
                 std::uint32_t max_priority = contract::max_priority) {
    GrantCall call;
    for (const std::string& drone : drones) call.add_drones(drone);
    call.mutable_grant()->mutable_to()->set_msp_id(msp_id);
    call.mutable_grant()->mutable_to()->set_subject(subject);
    call.mutable_grant()->set_fly(fly);
    call.mutable_grant()->set_cut(cut);
    if (fly) call.mutable_grant()->set_max_priority(max_priority);
    return stub.call(by, "grant", call);
  }

  Response enroll(const crypto::IdentityName& by, const crypto::IdentityName& who,
                  const std::vector<std::string>& drones, Role role) {
    EnrollCall call;
    call.mutable_identity()->set_msp_id(who.msp_id);
    call.mutable_identity()->set_subject(who.subject);
    for (const std::string& drone : drones) call.add_drones(drone);
    call.set_role(role);
    return stub.call(by, "enroll", call);
  }

  /// A plan for tello1.
  Response command(const crypto::IdentityName& by, std::uint64_t epoch) {
    return stub.call(by, "command", command_call(epoch));
  }

  static Asset asset(const std::string& id, const std::string& data = "data") {
    Asset asset;
    asset.set_id(id);
    asset.set_msg_type("std_msgs/msg/String");
    asset.set_msg_data(data);
    return asset;
  }

  Response set(const crypto::IdentityName& by, const std::vector<Asset>& assets, bool stream = false) {
    SetCall call;
    for (const Asset& one : assets) *call.add_assets() = one;
    call.set_stream(stream);
    return stub.call(by, "set", call);
  }

  std::string value_of(const std::string& id) {
    QueryCall query;
    query.set_id(id);
    const Response response = stub.call(other, "get", query);
    if (response.status != 200) return response.message;
    return parsed<Assets>(response.payload).assets(0).msg_data();
  }

  Control control(const std::string& drone) { return parsed<Control>(value_of("control/" + drone)); }

  FakeStub stub;
  const crypto::IdentityName admin1{"Org1MSP", "CN=Admin@org1"}, admin2{"Org2MSP", "CN=Admin@org2"};
  const crypto::IdentityName host{"Org1MSP", "CN=host"}, chief{"Org1MSP", "CN=chief"}, guard{"Org1MSP", "CN=guard"};
  const crypto::IdentityName pilot{"Org2MSP", "CN=pilot"}, rival{"Org2MSP", "CN=rival"}, other{"Org3MSP", "CN=other"};
};

}  // namespace ledgerline::chaincode
