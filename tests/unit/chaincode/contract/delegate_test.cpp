#include <gmock/gmock.h>

#include <functional>
#include <optional>

#include "chaincode/contract/contract_common.hpp"
#include "common/access/grants.hpp"
#include "tests/unit/chaincode/contract/fake_stub.hpp"

/// Who commands under a lease in its holder's place, and does nothing else.
namespace ledgerline::chaincode {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;
using ::testing::StartsWith;

class DelegateTest : public ContractTest {
 protected:
  Response lease_call(const crypto::IdentityName& by, const char* function,
                      const std::optional<crypto::IdentityName>& delegate, std::uint32_t priority = 0,
                      const std::string& drone = "tello1") {
    LeaseCall call;
    call.add_drones(drone);
    call.set_priority(priority);
    if (delegate) *call.mutable_delegate() = to_message(*delegate);
    return stub.call(by, function, call);
  }
  Response acquire(const crypto::IdentityName& by, const std::optional<crypto::IdentityName>& delegate,
                   std::uint32_t priority = 0, const std::string& drone = "tello1") {
    return lease_call(by, "acquire", delegate, priority, drone);
  }
  Response answer(const crypto::IdentityName& by, const char* function, const crypto::IdentityName& to) {
    AnswerCall call;
    call.add_drones("tello1");
    *call.mutable_to() = to_message(to);
    return stub.call(by, function, call);
  }
  Response revoke(const crypto::IdentityName& who) {
    RevokeCall call;
    *call.mutable_identity() = to_message(who);
    return stub.call({who.msp_id, "CN=Admin"}, "revoke", call);
  }
  Response fly(const crypto::IdentityName& by, const std::string& drone = "tello1", Action action = TAKEOFF) {
    CommandCall call = command_call(control(drone).epoch());
    call.mutable_plans(0)->set_drone(drone);
    call.mutable_plans(0)->set_action(action);
    return stub.call(by, "command", call);
  }
  std::uint64_t epoch(const std::string& drone = "tello1") { return control(drone).epoch(); }
  std::string commander(const std::string& drone = "tello1") { return commander_of(control(drone)).subject(); }

  const crypto::IdentityName station{"Org2MSP", "CN=station"};
};

TEST_F(DelegateTest, TheDelegateCommandsAndTheHolderDoesNot) {
  ASSERT_EQ(acquire(pilot, station).status, 200);
  const auto event = parsed<Controls>(stub.event_payload);
  EXPECT_EQ(event.controls(0).holder().subject(), "CN=pilot");
  EXPECT_EQ(event.controls(0).delegate().subject(), "CN=station");
  EXPECT_EQ(fly(station).status, 200);
  EXPECT_THAT(stub.reads, ElementsAre(StartsWith("lease/Org1MSP/"))) << "one record, as of a holder's command";
  EXPECT_THAT(stub.writes, SizeIs(1));
  EXPECT_TRUE(stub.policies.contains(stub.writes.begin()->first)) << "the acquire has made its key";
  EXPECT_EQ(fly(pilot).message,
            "tello1: the lease is held by Org2MSP CN=pilot, who lets Org2MSP CN=station command it; not by Org2MSP "
            "CN=pilot, who may acquire it without a delegate");
  EXPECT_EQ(fly(rival).message,
            "tello1: the lease is held by Org2MSP CN=pilot, who lets Org2MSP CN=station command it; not by Org2MSP "
            "CN=rival, who may request it");
}

TEST_F(DelegateTest, WithoutADelegateTheHolderCommandsAsBefore) {
  ASSERT_EQ(acquire(pilot, std::nullopt).status, 200);
  EXPECT_FALSE(control("tello1").has_delegate());
  EXPECT_EQ(fly(pilot).status, 200);
  EXPECT_THAT(fly(station).message, HasSubstr("held by Org2MSP CN=pilot, not by Org2MSP CN=station"));
}

TEST_F(DelegateTest, ADelegateIsAnotherOneOfTheHoldersOrganisation) {
  EXPECT_THAT(acquire(pilot, guard).message, HasSubstr("a delegate is of its holder's organisation"));
  EXPECT_THAT(acquire(pilot, pilot).message, HasSubstr("leave it out"));
  EXPECT_THAT(acquire(pilot, crypto::IdentityName{"Org2MSP", ""}).message, HasSubstr("needs mspId and subject"));
  EXPECT_THAT(acquire(pilot, crypto::IdentityName{}).message, HasSubstr("needs mspId and subject"));
  const std::string most = std::string(contract::max_subject_chars, 'x');
  EXPECT_THAT(acquire(pilot, crypto::IdentityName{"Org2MSP", most + "x"}).message, HasSubstr("the limit is 1024"));
  EXPECT_EQ(acquire(pilot, crypto::IdentityName{"Org2MSP", most}).status, 200);
  for (const char* function : {"acquire", "request"}) {
    EXPECT_THAT(lease_call(rival, function, guard).message,
                StartsWith(std::string(function) + ": Org1MSP CN=guard cannot"));
  }
  EXPECT_THAT(lease_call(pilot, "release", station).message,
              StartsWith("release: a delegate is of acquire and request"));
}

TEST_F(DelegateTest, NeitherTheRevokedNorAnAuditorIsADelegate) {
  revoke(station);
  EXPECT_THAT(acquire(pilot, station).message, StartsWith("acquire: delegate Org2MSP CN=station is revoked"));
  enroll(admin2, station, {}, AUDITOR);
  EXPECT_THAT(acquire(pilot, station).message, HasSubstr("is an auditor"));
  enroll(admin2, station, {}, OPERATOR);
  EXPECT_EQ(acquire(pilot, station).status, 200);
}

TEST_F(DelegateTest, AnotherDelegateIsAnotherEpochAndTheSameOneIsNot) {
  acquire(pilot, station);
  const std::uint64_t first = epoch();
  ASSERT_EQ(acquire(pilot, station).status, 200);
  EXPECT_TRUE(stub.writes.empty());
  ASSERT_EQ(acquire(pilot, std::nullopt).status, 200);
  EXPECT_GT(epoch(), first);
  EXPECT_EQ(fly(pilot).status, 200);
  EXPECT_NE(fly(station).status, 200);
  const std::uint64_t second = epoch();
  ASSERT_EQ(acquire(pilot, crypto::IdentityName{"Org2MSP", "CN=laptop"}).status, 200);
  EXPECT_GT(epoch(), second);
  EXPECT_EQ(commander(), "CN=laptop");
}

TEST_F(DelegateTest, ADelegateDoesNothingButCommand) {
  acquire(pilot, station, 5);
  lease_call(rival, "request", std::nullopt);
  stub.call(pilot, "stop", {"tello1"});
  for (const auto role : {ROLE_NONE, OPERATOR}) {
    if (role != ROLE_NONE) enroll(admin2, station, {}, role);
    EXPECT_THAT(stub.call(station, "release", {"tello1"}).message,
                HasSubstr("does not hold the lease; Org2MSP CN=pilot, who lets Org2MSP CN=station command it"));
    EXPECT_THAT(answer(station, "hand_over", rival).message, HasSubstr("does not hold the lease"));
    EXPECT_THAT(answer(station, "deny", rival).message, HasSubstr("may not deny it"));
    EXPECT_THAT(stub.call(station, "clear_stop", {"tello1"}).message, HasSubstr("only they, each its own"));
    EXPECT_THAT(stub.call(station, "evict", {"tello1"}).message, HasSubstr("may not evict"));
    EXPECT_THAT(stub.call(station, "apply_stops", {"tello1"}).message, HasSubstr("who alone applies its stops"));
    EXPECT_NE(stub.call(station, "acquire", {"tello1", "priority=5"}).status, 200);
  }
  revoke(station);
  for (const char* function : {"acquire", "request", "stop"}) {
    EXPECT_NE(stub.call(station, function, {"tello1", "priority=9"}).status, 200) << function;
  }
  const Control after = control("tello1");
  EXPECT_EQ(after.holder().subject(), "CN=pilot");
  EXPECT_THAT(after.requests(), SizeIs(1));
  EXPECT_THAT(after.stoppers(), SizeIs(1));
}

TEST_F(DelegateTest, ADelegateWithoutARoleStopsAndAcquiresNothing) {
  acquire(pilot, station);
  for (const char* function : {"stop", "acquire", "request"}) {
    EXPECT_THAT(stub.call(station, function, {"tello1"}).message, HasSubstr("neither operator nor supervisor"))
        << function;
  }
}

TEST_F(DelegateTest, WhatEndsTheLeaseEndsTheDelegatesCommands) {
  const auto ends = [&](const std::function<Response()>& end) {
    ASSERT_EQ(acquire(pilot, station).status, 200);
    const std::uint64_t under = epoch();
    ASSERT_EQ(fly(station).status, 200);
    const std::string read = stub.reads.front();
    ASSERT_EQ(end().status, 200);
    EXPECT_TRUE(stub.writes.contains(read)) << "what is in flight is invalid";
    EXPECT_FALSE(control("tello1").has_delegate());
    EXPECT_NE(command(station, under).status, 200);
    EXPECT_NE(fly(station).status, 200);
  };
  ends([&] { return stub.call(pilot, "release", {"tello1"}); });
  ends([&] { return stub.call(chief, "evict", {"tello1"}); });
  ends([&] { return stub.call(host, "evict", {"tello1"}); });
  ends([&] { return acquire(rival, std::nullopt, 9); });
  stub.call(rival, "release", {"tello1"});
  ends([&] { return grant(admin1, {"tello1"}, "Org2MSP", "", false); });
}

TEST_F(DelegateTest, RevokedTheLeaseEndsWhenTheHostAppliesStops) {
  acquire(pilot, station, 9);
  const std::uint64_t under = epoch();
  fly(station);
  const std::string read = stub.reads.front();
  revoke(station);
  const Control marked = control("tello1");
  ASSERT_THAT(marked.revoked(), SizeIs(1));
  EXPECT_EQ(marked.revoked(0).subject(), "CN=station");
  ASSERT_EQ(stub.call(host, "apply_stops", {"tello1"}).status, 200);
  EXPECT_TRUE(stub.writes.contains(read));
  const Control after = control("tello1");
  EXPECT_FALSE(after.has_holder());
  EXPECT_FALSE(after.has_delegate());
  EXPECT_THAT(after.revoked(), SizeIs(0));
  EXPECT_NE(command(station, under).status, 200);
}

TEST_F(DelegateTest, ALeaseOfARevokedDelegateKeepsNobodyOutAndItsHolderTakesAnother) {
  acquire(pilot, station, 9);
  revoke(station);
  EXPECT_EQ(acquire(pilot, std::nullopt).status, 200);
  EXPECT_THAT(control("tello1").revoked(), SizeIs(0));
  EXPECT_EQ(fly(pilot).status, 200);
  enroll(admin2, station, {}, OPERATOR);
  acquire(pilot, station, 9);
  revoke(station);
  EXPECT_EQ(acquire(rival, std::nullopt).status, 200);
}

TEST_F(DelegateTest, MadeAnAuditorItIsRevokedAsAHolderIs) {
  acquire(pilot, station);
  enroll(admin2, station, {}, AUDITOR);
  EXPECT_THAT(control("tello1").revoked(), SizeIs(1));
  ASSERT_EQ(stub.call(host, "apply_stops", {"tello1"}).status, 200);
  EXPECT_FALSE(control("tello1").has_holder());
}

TEST_F(DelegateTest, AHandOverGivesTheLeaseWithTheDelegateThatWasRequested) {
  acquire(pilot, station);
  const std::uint64_t before = epoch();
  ASSERT_EQ(lease_call(rival, "request", station, 3).status, 200);
  EXPECT_EQ(control("tello1").requests(0).delegate().subject(), "CN=station");
  EXPECT_EQ(fly(station).status, 200) << "the holder's flight goes on";
  ASSERT_EQ(answer(pilot, "hand_over", rival).status, 200);
  EXPECT_EQ(control("tello1").holder().subject(), "CN=rival");
  EXPECT_EQ(commander(), "CN=station");
  EXPECT_GT(epoch(), before) << "the same commander, another holder";
  EXPECT_NE(command(station, before).status, 200);
  EXPECT_EQ(fly(station).status, 200);
  lease_call(pilot, "request", std::nullopt);
  ASSERT_EQ(answer(rival, "hand_over", pilot).status, 200);
  EXPECT_FALSE(control("tello1").has_delegate()) << "asked for without one";
  EXPECT_EQ(fly(pilot).status, 200);
}

TEST_F(DelegateTest, ADelegateThatWasRevokedSinceTheRequestGetsNothing) {
  const crypto::IdentityName laptop{"Org2MSP", "CN=laptop"};
  acquire(pilot, station);
  for (const auto& delegate : {laptop, station}) {
    ASSERT_EQ(lease_call(rival, "request", delegate).status, 200);
    revoke(delegate);
    EXPECT_THAT(answer(pilot, "hand_over", rival).message, HasSubstr("whose organisation lets it command no more"))
        << delegate.subject;
  }
  EXPECT_EQ(control("tello1").holder().subject(), "CN=pilot");
}

TEST_F(DelegateTest, AStoppedDroneLandsByItsDelegate) {
  acquire(pilot, station);
  stub.call(guard, "stop", {"tello1"});
  stub.call(host, "apply_stops", {"tello1"});
  EXPECT_THAT(fly(station).message, HasSubstr("stopped by Org1MSP CN=guard"));
  EXPECT_EQ(fly(station, "tello1", LAND).status, 200);
  EXPECT_NE(fly(pilot, "tello1", LAND).status, 200);
}

/// pilot's tello1 and rival's tello2, both commanded by the station, under one epoch: one record names both.
class SharedDelegate : public DelegateTest {
 protected:
  SharedDelegate() {
    acquire(pilot, station, 0, "tello1");
    acquire(rival, station, 0, "tello2");
    EXPECT_EQ(epoch("tello1"), epoch("tello2"));
    under = epoch("tello1");
    fly(station, "tello1");
    record = stub.reads.front();
    fly(station, "tello2");
    EXPECT_EQ(stub.reads.front(), record);
  }
  Lease lease() { return parsed<Lease>(parsed<Stored>(stub.state.at(record)).assets(0).msg_data()); }
  Response both() {
    CommandCall call = command_call(under);
    *call.add_plans() = call.plans(0);
    call.mutable_plans(1)->set_drone("tello2");
    return stub.call(station, "command", call);
  }

  std::uint64_t under = 0;
  std::string record;
};

TEST_F(SharedDelegate, OneCommandFliesTheDronesOfBothHolders) {
  EXPECT_EQ(both().status, 200);
  EXPECT_THAT(stub.reads, ElementsAre(record));
  EXPECT_THAT(lease().drones(), ElementsAre("tello1", "tello2"));
}

TEST_F(SharedDelegate, WhatEndsOneLeaseLeavesTheOther) {
  ASSERT_EQ(stub.call(pilot, "release", {"tello1"}).status, 200);
  EXPECT_THAT(lease().drones(), ElementsAre("tello2"));
  EXPECT_EQ(fly(station, "tello2").status, 200);
  EXPECT_THAT(both().message, StartsWith("tello1: the lease is held by nobody"));
  ASSERT_EQ(acquire(pilot, station).status, 200);
  EXPECT_GT(epoch("tello1"), under);
  EXPECT_THAT(lease().drones(), ElementsAre("tello2"));
  EXPECT_THAT(both().message, StartsWith("tello1: the lease's epoch is"));
}

TEST_F(SharedDelegate, NeitherHolderHasASayInTheOthersLease) {
  EXPECT_THAT(stub.call(pilot, "release", {"tello2"}).message, HasSubstr("does not hold the lease"));
  EXPECT_THAT(stub.call(pilot, "release", {"tello1", "tello2"}).message, StartsWith("tello2: "));
  EXPECT_THAT(lease().drones(), ElementsAre("tello1", "tello2"));
}

TEST_F(SharedDelegate, AStopOfOneDroneLeavesTheOtherFlying) {
  stub.call(guard, "stop", {"tello1"});
  ASSERT_EQ(stub.call(host, "apply_stops", {"tello1"}).status, 200);
  EXPECT_THAT(lease().stopped(), ElementsAre("tello1"));
  EXPECT_EQ(fly(station, "tello2").status, 200);
  EXPECT_THAT(both().message, StartsWith("tello1: stopped by"));
  ASSERT_EQ(stub.call(rival, "release", {"tello2"}).status, 200);
  EXPECT_THAT(lease().stopped(), ElementsAre("tello1"));
  ASSERT_EQ(stub.call(guard, "clear_stop", {"tello1"}).status, 200);
  EXPECT_THAT(lease().stopped(), SizeIs(0));
  EXPECT_EQ(fly(station, "tello1").status, 200);
}

TEST_F(SharedDelegate, OneHolderRevokedTheOthersDroneFliesOn) {
  revoke(pilot);
  ASSERT_EQ(stub.call(host, "apply_stops", {"tello1", "tello2"}).status, 200);
  EXPECT_THAT(lease().drones(), ElementsAre("tello2"));
  EXPECT_EQ(fly(station, "tello2").status, 200);
}

TEST_F(SharedDelegate, TheirDelegateRevokedBothEnd) {
  revoke(station);
  ASSERT_EQ(stub.call(host, "apply_stops", {"tello1", "tello2"}).status, 200);
  EXPECT_THAT(lease().drones(), SizeIs(0));
  EXPECT_FALSE(control("tello1").has_holder() || control("tello2").has_holder());
}

TEST_F(SharedDelegate, OnePreemptedTheOtherFliesOn) {
  ASSERT_EQ(acquire(chief, std::nullopt, 1, "tello1").status, 200);
  EXPECT_THAT(lease().drones(), ElementsAre("tello2"));
  EXPECT_EQ(fly(station, "tello2").status, 200);
  EXPECT_EQ(fly(chief, "tello1").status, 200);
}

}  // namespace
}  // namespace ledgerline::chaincode
