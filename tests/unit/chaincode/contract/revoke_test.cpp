#include <gmock/gmock.h>

#include "tests/unit/chaincode/contract/fake_stub.hpp"

/// What an organisation takes back from one of its own, on everybody's drones.
namespace ledgerline::chaincode {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

class RevokeTest : public ContractTest {
 protected:
  Response revoke(const crypto::IdentityName& by, const crypto::IdentityName& who) {
    RevokeCall call;
    call.mutable_identity()->set_msp_id(who.msp_id);
    call.mutable_identity()->set_subject(who.subject);
    return stub.call(by, "revoke", call);
  }
  Response acquire(const crypto::IdentityName& by) { return stub.call(by, "acquire", {"tello1"}); }
  std::vector<std::string> revoked() {
    std::vector<std::string> names;
    const Control record = control("tello1");
    for (const Identity& who : record.revoked()) names.push_back(who.subject());
    return names;
  }
};

TEST_F(RevokeTest, OnlyAnAdministratorOfTheIdentitysOrganisationRevokes) {
  for (const auto& who : {admin1, pilot, chief, host}) {
    EXPECT_THAT(revoke(who, pilot).message, HasSubstr("only an administrator of Org2MSP may revoke")) << who.subject;
  }
  EXPECT_EQ(revoke(admin2, pilot).status, 200);
  EXPECT_THAT(revoke(admin2, {"Org2MSP", ""}).message, HasSubstr("identity needs mspId and subject"));
  EXPECT_THAT(revoke(admin2, {"Org2MSP", std::string(2'000, 'x')}).message, HasSubstr("the limit is 1024"));
  EXPECT_THAT(stub.call(admin2, "revoke", {"CN=pilot"}).message, StartsWith("revoke: give a RevokeCall"));
}

TEST_F(RevokeTest, ItWritesTheRoleAloneAndItsEventSaysWhose) {
  acquire(pilot);
  ASSERT_EQ(revoke(admin2, pilot).status, 200);
  EXPECT_THAT(stub.writes, SizeIs(1)) << "another organisation's records are not its own to write";
  EXPECT_THAT(stub.writes.begin()->first, StartsWith("role/"));
  const auto event = parsed<Controls>(stub.event_payload);
  EXPECT_EQ(stub.event_name, "revoke");
  EXPECT_EQ(event.identity().subject(), "CN=pilot");
  EXPECT_EQ(event.role(), REVOKED);
  EXPECT_EQ(revoke(admin2, pilot).status, 200);
  EXPECT_THAT(stub.writes, IsEmpty()) << "once more";
}

TEST_F(RevokeTest, WhoIsRevokedTakesStopsClearsAndEvictsNothing) {
  stub.call(chief, "stop", {"tello1"});
  for (const auto& [admin, who] : {std::pair(admin2, pilot), std::pair(admin1, chief)}) {
    ASSERT_EQ(revoke(admin, who).status, 200);
    for (const char* function : {"acquire", "stop", "clear_stop", "evict"}) {
      if (function == std::string("evict") && who == pilot) continue;  // who may not in any case
      EXPECT_THAT(stub.call(who, function, {"tello1"}).message,
                  HasSubstr(" is revoked; an administrator of " + who.msp_id + " may enroll it again"))
          << function;
    }
  }
}

TEST_F(RevokeTest, ApplyStopsOfTheHostEndsTheLeaseSoThatCommandsAreRefused) {
  acquire(pilot);
  const std::uint64_t epoch = control("tello1").epoch();
  revoke(admin2, pilot);
  EXPECT_THAT(revoked(), ElementsAre("CN=pilot"));
  EXPECT_EQ(command(pilot, epoch).status, 200) << "valid on the ledger, and flown by nobody";
  const std::string read = stub.reads.front();
  ASSERT_EQ(stub.call(host, "apply_stops", {"tello1"}).status, 200);
  EXPECT_TRUE(stub.writes.contains(read)) << "what is in flight is invalid";
  EXPECT_FALSE(control("tello1").has_holder());
  EXPECT_GT(control("tello1").epoch(), epoch);
  EXPECT_THAT(revoked(), IsEmpty());
  EXPECT_NE(command(pilot, epoch).status, 200);
}

TEST_F(RevokeTest, ApplyStopsEndsTheGrantsOfTheRevokedAndNobodyElses) {
  grant(admin1, {"tello1"}, "Org3MSP", "CN=other", true);
  grant(admin1, {"tello1"}, "Org3MSP", "", true);
  const crypto::IdentityName admin3{"Org3MSP", "CN=Admin@org3"};
  ASSERT_EQ(revoke(admin3, other).status, 200);
  EXPECT_THAT(revoked(), ElementsAre("CN=other"));
  ASSERT_EQ(stub.call(host, "apply_stops", {"tello1"}).status, 200);
  const Control after = control("tello1");
  ASSERT_EQ(after.grants_size(), 2);
  EXPECT_EQ(after.grants(1).to().msp_id() + after.grants(1).to().subject(), "Org3MSP");
  EXPECT_THAT(grant(admin1, {"tello1"}, "Org3MSP", "CN=other", true).message, HasSubstr("is revoked"));
}

TEST_F(RevokeTest, ARevokedHolderKeepsNobodyOut) {
  stub.call(pilot, "acquire", {"tello1", "priority=9"});
  revoke(admin2, pilot);
  EXPECT_EQ(acquire(rival).status, 200);
  EXPECT_EQ(control("tello1").holder().subject(), "CN=rival");
  EXPECT_THAT(revoked(), IsEmpty());
}

TEST_F(RevokeTest, EnrolledAgainItIsNoLongerRevoked) {
  acquire(pilot);
  revoke(admin2, pilot);
  ASSERT_EQ(enroll(admin2, pilot, {}, OPERATOR).status, 200);
  EXPECT_THAT(revoked(), IsEmpty());
  EXPECT_EQ(acquire(pilot).status, 200);
  EXPECT_THAT(enroll(admin2, pilot, {}, REVOKED).message, HasSubstr("call revoke"));
}

TEST_F(RevokeTest, EnrolledAgainBeforeApplyStopsItHasItsLeaseAgainAndAfterItNot) {
  acquire(pilot);
  const std::uint64_t epoch = control("tello1").epoch();
  revoke(admin2, pilot);
  enroll(admin2, pilot, {}, OPERATOR);
  EXPECT_EQ(command(pilot, epoch).status, 200);
  EXPECT_EQ(control("tello1").holder().subject(), "CN=pilot");
  revoke(admin2, pilot);
  ASSERT_EQ(stub.call(host, "apply_stops", {"tello1"}).status, 200);
  enroll(admin2, pilot, {}, OPERATOR);
  EXPECT_FALSE(control("tello1").has_holder());
}

TEST_F(RevokeTest, ToBeMadeAnAuditorTakesBackAsMuch) {
  grant(admin1, {"tello1"}, "Org3MSP", "CN=other", true);
  acquire(pilot);
  ASSERT_EQ(enroll(admin2, pilot, {}, AUDITOR).status, 200);
  EXPECT_THAT(revoked(), ElementsAre("CN=pilot"));
  EXPECT_THAT(acquire(pilot).message, HasSubstr("neither operator nor supervisor"));
  EXPECT_EQ(acquire(rival).status, 200) << "it keeps nobody out";
  const crypto::IdentityName admin3{"Org3MSP", "CN=Admin@org3"};
  ASSERT_EQ(enroll(admin3, other, {}, AUDITOR).status, 200);
  EXPECT_THAT(grant(admin1, {"tello1"}, "Org3MSP", "CN=other", true).message, HasSubstr("neither operator nor"));
}

TEST_F(RevokeTest, TheGrantOfTheRevokedMayBeWithdrawn) {
  grant(admin1, {"tello1"}, "Org3MSP", "CN=other", true);
  const int before = control("tello1").grants_size();
  ASSERT_EQ(revoke({"Org3MSP", "CN=Admin@org3"}, other).status, 200);
  EXPECT_EQ(grant(admin1, {"tello1"}, "Org3MSP", "CN=other", false).status, 200);
  EXPECT_EQ(control("tello1").grants_size(), before - 1);
}

TEST_F(RevokeTest, AGrantWithdrawnMeanwhileEndsTheLeaseOfTheRevokedToo) {
  acquire(pilot);
  const std::uint64_t epoch = control("tello1").epoch();
  revoke(admin2, pilot);
  ASSERT_EQ(grant(admin1, {"tello1"}, "Org2MSP", "", false).status, 200);
  ASSERT_EQ(enroll(admin2, pilot, {}, OPERATOR).status, 200);
  EXPECT_FALSE(control("tello1").has_holder()) << "enrolled again before apply_stops it has no lease without a grant";
  EXPECT_NE(command(pilot, epoch).status, 200);
}

TEST_F(RevokeTest, ARevokedHolderHandsNothingOverAndDeniesNobody) {
  acquire(pilot);
  LeaseCall lease_call;
  lease_call.add_drones("tello1");
  ASSERT_EQ(stub.call(rival, "request", lease_call).status, 200);
  revoke(admin2, pilot);
  AnswerCall answer;
  answer.add_drones("tello1");
  answer.mutable_to()->set_msp_id(rival.msp_id);
  answer.mutable_to()->set_subject(rival.subject);
  EXPECT_THAT(stub.call(pilot, "hand_over", answer).message, HasSubstr("is revoked"));
  EXPECT_THAT(stub.call(pilot, "deny", answer).message, HasSubstr("is revoked"));
  EXPECT_EQ(stub.call(pilot, "release", {"tello1"}).status, 200) << "it may give back what it holds";
}

TEST_F(RevokeTest, ARevokedHostOwnsNothingUntilItIsEnrolledAgain) {
  ASSERT_EQ(set(host, {asset("tello1/odom")}, true).status, 200);
  ASSERT_EQ(revoke(admin1, host).status, 200);
  EXPECT_NE(set(host, {asset("tello1/odom")}, true).status, 200);
  EXPECT_NE(set(host, {asset("tello2/note")}).status, 200);
  EXPECT_EQ(value_of("tello1/odom"), "data");
  ASSERT_EQ(enroll(admin1, host, {"tello1"}, ROLE_NONE).status, 200);
  EXPECT_EQ(set(host, {asset("tello1/odom")}, true).status, 200);
  EXPECT_NE(set(host, {asset("tello2/note")}).status, 200);
}

}  // namespace
}  // namespace ledgerline::chaincode
