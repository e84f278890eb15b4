#include <gmock/gmock.h>

#include "chaincode/contract/contract_common.hpp"
#include "tests/unit/chaincode/contract/fake_stub.hpp"

/// Roles: each organisation has its own place for them, and none can take another's.
namespace ledgerline::chaincode {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

class RolesTest : public ContractTest {
 protected:
  static crypto::IdentityName numbered(int i, const std::string& msp_id = "Org3MSP") {
    return {msp_id, "CN=s" + std::to_string(i)};
  }
  std::vector<std::string> keys(const std::string& prefix) const {
    std::vector<std::string> found;
    for (const auto& [key, value] : stub.state) {
      if (key.starts_with(prefix)) found.push_back(key);
    }
    return found;
  }
  static std::vector<std::string> roles_in(const std::vector<std::string>& touched) {
    std::vector<std::string> found;
    std::ranges::copy_if(touched, std::back_inserter(found), [](const auto& key) { return key.starts_with("role/"); });
    return found;
  }
  /// As the version before kept a role.
  void keep_as_before(const crypto::IdentityName& who, Role role) {
    EnrollCall record;
    *record.mutable_identity() = to_message(who);
    record.set_role(role);
    Stored stored;
    stored.add_assets()->set_id(role_key_before(who));
    stored.mutable_assets(0)->set_msg_data(record.SerializeAsString());
    stub.state[role_key_before(who)] = stored.SerializeAsString();
  }
  void forget_tables(const std::string& msp_id) {
    std::erase_if(stub.state, [&](const auto& one) { return one.first.starts_with("role/" + msp_id + "/"); });
  }
  Response revoke(const crypto::IdentityName& by, const crypto::IdentityName& who) {
    RevokeCall call;
    *call.mutable_identity() = to_message(who);
    return stub.call(by, "revoke", call);
  }
  const crypto::IdentityName admin3{"Org3MSP", "CN=Admin@org3"};
};

TEST_F(RolesTest, OneOrganisationFillsItsOwnPlaceAlone) {
  int taken = 0;
  std::string refusal;
  for (int i = 0; i < 10'050; ++i) {
    const Response response = enroll(admin3, numbered(i), {}, AUDITOR);
    taken += response.status == 200 ? 1 : 0;
    if (response.status != 200) refusal = response.message;
  }
  EXPECT_LE(taken, 1'024);
  EXPECT_GT(taken, 700) << "an honest organisation reaches most of it";
  EXPECT_THAT(refusal, HasSubstr("enroll: Org3MSP has no place for a role of CN=s"));
  EXPECT_THAT(keys("role/Org3MSP/"), SizeIs(16));
  EXPECT_EQ(enroll(admin2, numbered(1, "Org2MSP"), {}, OPERATOR).status, 200);
  EXPECT_EQ(enroll(admin3, numbered(1), {}, OPERATOR).status, 200) << "who is there keeps its place";
}

TEST_F(RolesTest, ARevocationFindsAPlaceWhereAnEnrolmentDoesNot) {
  for (int i = 0; i < 1'400; ++i) enroll(admin3, numbered(i), {}, OPERATOR);
  for (int i = 0; i < 1'400; ++i) ASSERT_EQ(revoke(admin3, numbered(i)).status, 200) << i;
  int more = 0;
  for (int i = 1'400; i < 10'000; ++i) more += revoke(admin3, numbered(i)).status == 200 ? 1 : 0;
  EXPECT_LE(more, 1'024) << "which has a bound, too";
}

TEST_F(RolesTest, LongNamesHaveABoundOfBytes) {
  for (int i = 0; i < 1'000; ++i) {
    crypto::IdentityName who = numbered(i);
    who.subject += std::string(1'000, 'x');
    enroll(admin3, who, {}, OPERATOR);
  }
  for (const std::string& key : keys("role/Org3MSP/"))
    EXPECT_LE(value_of(key).size(), contract::max_table_bytes / 2) << key;
}

TEST_F(RolesTest, ARoleIsReadFromOneKeyAndWrittenToOne) {
  ASSERT_EQ(enroll(admin2, numbered(1, "Org2MSP"), {}, OPERATOR).status, 200);
  EXPECT_THAT(stub.writes, SizeIs(1));
  ASSERT_EQ(stub.call(guard, "stop", {"tello1"}).status, 200);
  EXPECT_THAT(roles_in(stub.reads), SizeIs(1));
  EXPECT_THAT(stub.ranges, IsEmpty());
}

TEST_F(RolesTest, AllTablesAreMadeAtOnceSoThatNobodyElseMakesOne) {
  ASSERT_EQ(enroll(admin3, {"Org3MSP", "CN=host3"}, {"far1"}, ROLE_NONE).status, 200) << "whatever is enrolled first";
  const auto tables = keys("role/Org3MSP/");
  ASSERT_THAT(tables, SizeIs(16));
  for (const std::string& key : tables) EXPECT_EQ(stub.policies[key], "Org3MSP") << key;
  ASSERT_EQ(enroll(admin3, {"Org3MSP", "CN=host3"}, {"far2"}, ROLE_NONE).status, 200);
  for (const auto& [key, value] : stub.writes) EXPECT_THAT(key, ::testing::Not(StartsWith("role/"))) << "made once";
}

TEST_F(RolesTest, RolesOfTheVersionBeforeCountUntilTheirOrganisationWritesOne) {
  forget_tables("Org2MSP");
  keep_as_before(pilot, OPERATOR);
  keep_as_before(rival, REVOKED);
  keep_as_before(guard, SUPERVISOR);  // of an organisation that has tables
  EXPECT_EQ(stub.call(pilot, "stop", {"tello1"}).status, 200);
  EXPECT_THAT(stub.call(rival, "stop", {"tello1"}).message, HasSubstr("is revoked"));
  ASSERT_EQ(enroll(admin2, numbered(1, "Org2MSP"), {}, OPERATOR).status, 200);
  EXPECT_THAT(keys("role/Org2MSP/"), SizeIs(16));
  EXPECT_EQ(stub.call(pilot, "stop", {"tello2"}).status, 200) << "moved";
  EXPECT_THAT(roles_in(stub.reads), SizeIs(1)) << "the record of before is read no more";
  EXPECT_THAT(stub.call(rival, "stop", {"tello1"}).message, HasSubstr("is revoked")) << "moved as well";
  EXPECT_THAT(stub.call(guard, "evict", {"tello1"}).message, HasSubstr("may not evict"))
      << "whichever identity wrote that record";
}

TEST_F(RolesTest, WhatTwoOthersMakeInThePlaceOfBeforeBuysNothingOnceThereAreTables) {
  keep_as_before(other, SUPERVISOR);
  EXPECT_EQ(stub.call(other, "acquire", {"tello1"}).status, 500);
  ASSERT_EQ(enroll(admin3, numbered(1), {}, OPERATOR).status, 200);
  keep_as_before(numbered(2), SUPERVISOR);
  EXPECT_THAT(stub.call(numbered(2), "stop", {"tello1"}).message, HasSubstr("neither operator nor supervisor"));
}

TEST_F(RolesTest, TheMoveLeavesAuditorsOutFirst) {
  for (int i = 0; i < 3'000; ++i) keep_as_before(numbered(i), AUDITOR);
  keep_as_before(numbered(5'000), OPERATOR);
  keep_as_before(numbered(5'001), REVOKED);
  grant(admin1, {"tello1"}, "Org3MSP", "", true);
  ASSERT_EQ(enroll(admin3, numbered(5'000), {}, OPERATOR).status, 200) << "who has a role already finds its place";
  EXPECT_EQ(stub.call(numbered(5'000), "stop", {"tello1"}).status, 200);
  EXPECT_THAT(stub.call(numbered(5'001), "stop", {"tello1"}).message, HasSubstr("is revoked"));
}

}  // namespace
}  // namespace ledgerline::chaincode
