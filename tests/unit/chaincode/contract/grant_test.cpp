#include <gmock/gmock.h>

#include "tests/unit/chaincode/contract/fake_stub.hpp"

/// What a drone's organisation lets others do with it: granted, bounded, taken back.
namespace ledgerline::chaincode {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;
using ::testing::StartsWith;

class GrantTest : public ContractTest {
 protected:
  GrantTest() {
    enroll(admin3, far, {}, OPERATOR);
    enroll(admin3, far_chief, {}, SUPERVISOR);
  }
  Response acquire(const crypto::IdentityName& by, std::uint32_t priority = 0, const std::string& drone = "tello1") {
    LeaseCall call;
    call.add_drones(drone);
    call.set_priority(priority);
    return stub.call(by, "acquire", call);
  }
  std::string holder() { return control("tello1").holder().subject(); }

  const crypto::IdentityName admin3{"Org3MSP", "CN=Admin@org3"}, far{"Org3MSP", "CN=far"},
      far_chief{"Org3MSP", "CN=far chief"};
};

TEST_F(GrantTest, ARoleThatAnOrganisationGivesItsOwnMeansNothingOnOthersDrones) {
  for (const auto& who : {far, far_chief}) {
    EXPECT_THAT(acquire(who, contract::max_priority).message,
                AllOf(StartsWith("tello1: Org3MSP CN=far"), HasSubstr("an administrator of Org1MSP may")));
    EXPECT_NE(stub.call(who, "stop", {"tello1"}).status, 200);
    EXPECT_NE(stub.call(who, "evict", {"tello1"}).status, 200);
  }
  EXPECT_EQ(grant(admin1, {"tello1"}, "Org3MSP", "CN=far", true).status, 200);
  EXPECT_EQ(acquire(far).status, 200);
  EXPECT_NE(acquire(far_chief, 1).status, 200) << "granted to another identity";
  EXPECT_NE(acquire(far, 0, "tello2").status, 200) << "of another drone";
}

TEST_F(GrantTest, AGrantWithoutARoleMeansNothing) {
  EXPECT_EQ(grant(admin1, {"tello1"}, "Org3MSP", "", true, true).status, 200);
  EXPECT_THAT(acquire(other).message, HasSubstr("neither operator nor supervisor; an administrator of Org3MSP may"));
  EXPECT_NE(stub.call(other, "stop", {"tello1"}).status, 200);
}

TEST_F(GrantTest, OnlyAnAdministratorOfTheOwnerGrants) {
  for (const auto& who : {chief, host, admin2, admin3, far}) {
    EXPECT_THAT(grant(who, {"tello1"}, "Org3MSP", "", true).message, HasSubstr("only an administrator of Org1MSP may"));
  }
  EXPECT_THAT(grant(admin1, {"tello9"}, "Org3MSP", "", true).message, StartsWith("tello9: not enrolled"));
  EXPECT_THAT(grant(admin1, {"tello1"}, "Org1MSP", "", true).message, HasSubstr("need no grant"));
  EXPECT_THAT(grant(admin1, {"tello1"}, "", "", true).message, StartsWith("grant: to needs mspId"));
  EXPECT_THAT(stub.call(admin1, "grant", {"tello1"}).message, StartsWith("grant: give a GrantCall"));
  EXPECT_NE(grant(admin1, {"tello1"}, std::string(2000, 'a'), "", true).status, 200);
}

TEST_F(GrantTest, APriorityIsBoundedByTheGrantTheCallByTheContract) {
  grant(admin1, {"tello1"}, "Org3MSP", "", true, false, 5);
  EXPECT_THAT(acquire(far, 6).message,
              StartsWith("tello1: Org1MSP has granted Org3MSP CN=far priorities up to 5, not 6"));
  EXPECT_EQ(acquire(far, 5).status, 200);
  EXPECT_NE(acquire(guard, contract::max_priority + 1).status, 200);
  EXPECT_NE(grant(admin1, {"tello1"}, "Org3MSP", "", true, false, contract::max_priority + 1).status, 200);
  EXPECT_EQ(acquire(guard, contract::max_priority).status, 200) << "the owner's own";
  GrantCall bound_alone;
  bound_alone.add_drones("tello1");
  bound_alone.mutable_grant()->mutable_to()->set_msp_id("Org3MSP");
  bound_alone.mutable_grant()->set_max_priority(1);
  EXPECT_THAT(stub.call(admin1, "grant", bound_alone).message, HasSubstr("set fly, too"));
}

TEST_F(GrantTest, TheGrantsOfAnIdentityAndOfItsOrganisationAdd) {
  grant(admin1, {"tello1"}, "Org3MSP", "", true, false, 5);
  grant(admin1, {"tello1"}, "Org3MSP", "CN=far", true, true, 3);
  EXPECT_EQ(acquire(far, 5).status, 200);
  EXPECT_EQ(stub.call(far, "stop", {"tello1", "cut=true"}).status, 200);
  EXPECT_NE(stub.call(far_chief, "stop", {"tello1", "cut=true"}).status, 200);
  EXPECT_EQ(stub.call(far_chief, "stop", {"tello1"}).status, 200) << "who may fly may stop, with or without a lease";
}

TEST_F(GrantTest, AGrantOfNothingTakesItBackAndWithItTheLease) {
  grant(admin1, {"tello1"}, "Org3MSP", "", true);
  acquire(far);
  const std::uint64_t epoch = control("tello1").epoch();
  EXPECT_EQ(command(far, epoch).status, 200);
  const std::string read = stub.reads.front();
  EXPECT_EQ(grant(admin1, {"tello1"}, "Org3MSP", "", false).status, 200);
  EXPECT_TRUE(stub.writes.contains(read)) << "what is in flight is invalid (MVCC)";
  const auto event = parsed<Controls>(stub.event_payload);
  EXPECT_EQ(stub.event_name, "grant");
  ASSERT_THAT(event.controls(), SizeIs(1));
  EXPECT_FALSE(event.controls(0).has_holder());
  EXPECT_GT(event.controls(0).epoch(), epoch);
  EXPECT_NE(command(far, epoch).status, 200);
  EXPECT_NE(acquire(far).status, 200);
}

TEST_F(GrantTest, ANarrowerGrantLowersThePriorityOfTheLease) {
  grant(admin1, {"tello1"}, "Org3MSP", "", true);
  acquire(far, 100);
  const std::uint64_t epoch = control("tello1").epoch();
  grant(admin1, {"tello1"}, "Org3MSP", "", true, false, 5);
  EXPECT_EQ(holder(), "CN=far");
  EXPECT_EQ(control("tello1").priority(), 5U);
  EXPECT_EQ(control("tello1").epoch(), epoch);
  EXPECT_EQ(acquire(pilot, 6).status, 200);
}

TEST_F(GrantTest, AGrantToOthersLeavesTheLeaseAlone) {
  acquire(pilot, 7);
  const Control before = control("tello1");
  grant(admin1, {"tello1"}, "Org3MSP", "", true);
  EXPECT_THAT(stub.writes, SizeIs(1)) << "the drone's grants alone";
  EXPECT_EQ(control("tello1").epoch(), before.epoch());
  EXPECT_EQ(control("tello1").priority(), 7U);
  EXPECT_EQ(control("tello1").grants_size(), 2);
  grant(admin1, {"tello1"}, "Org3MSP", "", true);
  EXPECT_THAT(stub.writes, IsEmpty()) << "the same again";
}

TEST_F(GrantTest, ADroneHasAsManyGrantsAsTheBoundSays) {
  for (std::size_t i = 1; i < contract::max_drone_grants; ++i) {
    EXPECT_EQ(grant(admin1, {"tello1"}, "Org3MSP", "CN=" + std::to_string(i), true).status, 200) << i;
  }
  EXPECT_THAT(grant(admin1, {"tello1"}, "Org3MSP", "CN=more", true).message, HasSubstr("64 grants already"));
}

TEST_F(GrantTest, AnEvictionOfOneEpochEndsNoOther) {
  acquire(pilot);
  const std::uint64_t epoch = control("tello1").epoch();
  DronesCall call;
  call.add_drones("tello1");
  call.add_epochs(epoch);
  const std::string old = call.SerializeAsString();
  acquire(rival, contract::max_priority);
  EXPECT_THAT(stub.call(host, "evict", {old}).message, HasSubstr("not the one of epoch " + std::to_string(epoch)));
  EXPECT_TRUE(control("tello1").has_holder());
  call.add_epochs(epoch);
  EXPECT_THAT(stub.call(host, "evict", {call.SerializeAsString()}).message, HasSubstr("2 epochs for 1 drones"));
  call.mutable_epochs()->Clear();
  call.add_epochs(control("tello1").epoch());
  EXPECT_EQ(stub.call(host, "evict", {call.SerializeAsString()}).status, 200);
  EXPECT_FALSE(control("tello1").has_holder());
}

TEST_F(GrantTest, TheOwnersSupervisorAndTheHostEvict) {
  EXPECT_THAT(stub.call(chief, "evict", {"tello1"}).message, StartsWith("tello1: nobody holds the lease"));
  for (const auto& who : {chief, host}) {
    acquire(pilot, contract::max_priority);
    const std::uint64_t epoch = control("tello1").epoch();
    EXPECT_EQ(command(pilot, epoch).status, 200);
    const std::string read = stub.reads.front();
    EXPECT_EQ(stub.call(who, "evict", {"tello1"}).status, 200);
    EXPECT_TRUE(stub.writes.contains(read));
    EXPECT_FALSE(control("tello1").has_holder());
    EXPECT_GT(control("tello1").epoch(), epoch);
    EXPECT_NE(command(pilot, epoch).status, 200);
  }
  acquire(pilot);
  for (const auto& who : {guard, pilot, rival, far_chief, admin1, other}) {
    EXPECT_THAT(stub.call(who, "evict", {"tello1"}).message, HasSubstr("may not evict")) << who.subject;
  }
  EXPECT_EQ(holder(), "CN=pilot");
}

TEST_F(GrantTest, AStopReadsWhatAdministratorsAloneWrite) {
  acquire(pilot);
  for (const auto& who : {chief, pilot, rival}) {
    EXPECT_EQ(stub.call(who, "stop", {"tello1"}).status, 200);
    EXPECT_THAT(stub.reads, Not(Contains(StartsWith("control/"))));
    EXPECT_THAT(stub.reads, Not(Contains(StartsWith("lease/"))));
    EXPECT_THAT(stub.reads, Not(Contains(AllOf(StartsWith("stop/"), Not(EndsWith("/lifted"))))));
    EXPECT_THAT(stub.ranges, IsEmpty());
  }
}

}  // namespace
}  // namespace ledgerline::chaincode
