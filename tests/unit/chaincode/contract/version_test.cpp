#include <gmock/gmock.h>

#include "tests/unit/chaincode/contract/fake_stub.hpp"

/// A ledger of the version before, which had no policies of keys and one lease of a holder for all organisations, under
/// the contract of today.
namespace ledgerline::chaincode {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

class VersionTest : public ContractTest {
 protected:
  /// As the version before kept its records.
  void go_back() {
    std::map<std::string, std::string> before;
    for (const auto& [key, value] : stub.state) {
      const std::string kind = key.substr(0, key.find('/'));
      Stored stored;
      EXPECT_TRUE(stored.ParseFromString(value)) << key;
      if (kind == "pilot" || (kind == "frame" && stored.assets().empty())) continue;
      stored.set_version(0);
      const std::string org = "/Org1MSP/";
      const bool of_organisation = (kind == "lease" || kind == "command") && key.find(org) != std::string::npos;
      before[of_organisation ? kind + "/" + key.substr(kind.size() + org.size()) : key] = stored.SerializeAsString();
    }
    stub.state = std::move(before);
    stub.policies.clear();
  }
  Response apply_stops(const std::string& drone) { return stub.call(host, "apply_stops", {drone}); }
  std::vector<std::string> without_policy(const std::string& kind) const {
    std::vector<std::string> keys;
    for (const auto& [key, value] : stub.state) {
      if (key.starts_with(kind + "/") && !stub.policies.contains(key)) keys.push_back(key);
    }
    return keys;
  }
};

TEST_F(VersionTest, WhatIsMadeTodayHasItsKeepersPolicy) {
  stub.call(pilot, "acquire", {"tello1"});
  for (const char* kind :
       {"control", "owner", "grant", "request", "host", "frame", "drones", "lease", "pilot", "command"}) {
    EXPECT_THAT(without_policy(kind), ::testing::IsEmpty());
    for (const auto& [key, msp_id] : stub.policies) {
      if (key.starts_with(std::string(kind) + "/")) {
        EXPECT_EQ(msp_id, "Org1MSP") << key;
      }
    }
  }
  for (const auto& [key, msp_id] : stub.policies) {
    if (key.starts_with("role/")) {
      EXPECT_EQ(key.substr(0, key.size() - 1), "role/" + msp_id + "/") << key;
    }
  }
}

TEST_F(VersionTest, ApplyStopsOfTheHostRenewsWhatFliesAndTheLeaseGoesOn) {
  stub.call(pilot, "acquire", {"tello1"});
  go_back();
  EXPECT_THAT(command(pilot, 1).message, HasSubstr("its host's apply_stops renews"));
  ASSERT_EQ(apply_stops("tello1").status, 200);
  for (const char* kind : {"host", "frame", "lease", "pilot"}) {
    for (const std::string& key : without_policy(kind)) EXPECT_THAT(key, StartsWith("lease/")) << "the old one stays";
  }
  for (const char* kind : {"control", "owner", "grant", "request"}) {
    EXPECT_TRUE(stub.policies.contains(std::string(kind) + "/tello1")) << kind;
    EXPECT_FALSE(stub.policies.contains(std::string(kind) + "/tello2"))
        << kind << ": nobody has called apply_stops for that one";
  }
  EXPECT_EQ(command(pilot, 1).status, 200) << "under the same epoch";
  ASSERT_EQ(apply_stops("tello1").status, 200);
  EXPECT_TRUE(stub.new_policies.empty()) << "a policy is set once";
}

TEST_F(VersionTest, AStopFromBeforeStillStands) {
  stub.call(pilot, "acquire", {"tello1"});
  stub.call(guard, "stop", {"tello1"});
  go_back();
  ASSERT_EQ(apply_stops("tello1").status, 200);
  EXPECT_THAT(command(pilot, 1).message, HasSubstr("stopped by Org1MSP CN=guard"));
  ASSERT_EQ(stub.call(guard, "clear_stop", {"tello1"}).status, 200);
  EXPECT_EQ(command(pilot, 1).status, 200);
}

TEST_F(VersionTest, AnyControlCallRenewsTheDroneThatItChanges) {
  go_back();
  ASSERT_EQ(stub.call(pilot, "acquire", {"tello2"}).status, 200);
  EXPECT_TRUE(stub.policies.contains("control/tello2"));
  EXPECT_FALSE(stub.policies.contains("control/tello1"));
  EXPECT_EQ(set(host, {asset("tello2/odom")}, true).status, 200);
}

TEST_F(VersionTest, AStateMakesNoPolicyAndClaimsNone) {
  go_back();
  ASSERT_EQ(set(host, {asset("tello1/odom")}, true).status, 200);
  EXPECT_TRUE(stub.policies.empty());
  ASSERT_EQ(apply_stops("tello1").status, 200);
  EXPECT_FALSE(stub.policies.empty()) << "the host's record that the state has written is still an old one";
  EXPECT_THAT(without_policy("host"), ::testing::IsEmpty());
}

}  // namespace
}  // namespace ledgerline::chaincode
