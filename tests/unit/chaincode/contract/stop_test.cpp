#include <gmock/gmock.h>

#include "chaincode/contract/records.hpp"
#include "common/access/stops.hpp"
#include "tests/unit/chaincode/contract/fake_stub.hpp"

/// Who stops and cuts which drone and clears whose stop, and what each of these calls reads and writes.
namespace ledgerline::chaincode {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

class StopTest : public ContractTest {
 protected:
  StopTest() {
    enroll({"Org3MSP", "CN=Admin@org3"}, far_chief, {}, SUPERVISOR);
    GrantCall stops;
    stops.add_drones("tello1");
    stops.mutable_grant()->mutable_to()->set_msp_id("Org3MSP");
    stops.mutable_grant()->set_stop(true);
    stub.call(admin1, "grant", stops);
    grant(admin1, {"tello1", "tello2"}, "Org2MSP", "", false);
    grant(admin1, {"tello1", "tello2"}, "Org2MSP", pilot.subject, true, true);
    LeaseCall lease;
    lease.add_drones("tello1");
    stub.call(pilot, "acquire", lease);
  }

  /// A command with one plan; `action` FLY has a setpoint.
  Response command(Action action = FLY) {
    return stub.call(pilot, "command", command_call(control("tello1").epoch(), action));
  }
  int stop(const crypto::IdentityName& by) { return stub.call(by, "stop", {"tello1"}).status; }
  int cut(const crypto::IdentityName& by) { return stub.call(by, "stop", {"tello1", "cut=true"}).status; }
  int clear_stop(const crypto::IdentityName& by) { return stub.call(by, "clear_stop", {"tello1"}).status; }
  std::string stoppers() { return stopper_names(control("tello1")); }

  const crypto::IdentityName far_chief{"Org3MSP", "CN=far"};
};

TEST_F(StopTest, AForeignSupervisorClearsNobodysStopInTwoCallsEither) {
  EXPECT_EQ(stop(chief), 200);
  EXPECT_NE(clear_stop(far_chief), 200);
  EXPECT_EQ(stop(far_chief), 200) << "he is granted that";
  EXPECT_EQ(clear_stop(far_chief), 200) << "his own";
  EXPECT_EQ(stoppers(), "Org1MSP CN=chief");
  EXPECT_NE(clear_stop(far_chief), 200);
  EXPECT_EQ(stub.call(host, "apply_stops", {"tello1"}).status, 200);
  EXPECT_THAT(command().message, HasSubstr("stopped by Org1MSP CN=chief"));
}

TEST_F(StopTest, AForeignSupervisorDoesNotCutNorTakeACutBack) {
  EXPECT_THAT(stub.call(far_chief, "stop", {"tello1", "cut=true"}).message,
              StartsWith("tello1: Org3MSP CN=far may not cut it: Org1MSP has granted that neither to this identity"));
  EXPECT_THAT(stoppers(), IsEmpty());
  EXPECT_EQ(cut(chief), 200);
  EXPECT_EQ(stop(far_chief), 200);
  EXPECT_TRUE(is_cut(control("tello1")));
  EXPECT_EQ(clear_stop(far_chief), 200);
  EXPECT_TRUE(is_cut(control("tello1")));
}

TEST_F(StopTest, OperatorsAndSupervisorsOfTheOrganisationAndTheGrantedStop) {
  EXPECT_EQ(stop(guard), 200);
  EXPECT_EQ(stop(pilot), 200);
  EXPECT_EQ(stop(chief), 200);
  EXPECT_THAT(stub.call(rival, "stop", {"tello1"}).message, StartsWith("tello1: Org2MSP CN=rival may not stop it"));
  EXPECT_NE(stop(host), 200) << "no role, no stop";
  EXPECT_NE(stop(other), 200);
  EXPECT_THAT(stub.call(chief, "stop", {"tello9"}).message, StartsWith("tello9: not enrolled"));
  EXPECT_EQ(stoppers(), "Org1MSP CN=chief, Org1MSP CN=guard, Org2MSP CN=pilot") << "in order";
}

TEST_F(StopTest, OperatorsAndSupervisorsOfTheOrganisationAndTheGrantedCut) {
  EXPECT_EQ(cut(guard), 200);
  EXPECT_EQ(cut(chief), 200);
  EXPECT_EQ(cut(pilot), 200);
  EXPECT_NE(cut(rival), 200);
  EXPECT_NE(cut(host), 200);
  EXPECT_EQ(stub.call(pilot, "stop", {"tello2", "cut=true"}).status, 200) << "granted, lease or not";
}

TEST_F(StopTest, TheHolderCutsOnlyWhereThatIsGranted) {
  grant(admin1, {"tello2"}, "Org3MSP", "", true);
  LeaseCall lease;
  lease.add_drones("tello2");
  EXPECT_EQ(stub.call(far_chief, "acquire", lease).status, 200);
  EXPECT_NE(stub.call(far_chief, "stop", {"tello2", "cut=true"}).status, 200);
  EXPECT_EQ(stub.call(far_chief, "stop", {"tello2"}).status, 200);
}

TEST_F(StopTest, EachClearsItsOwnAndTheOwnersSupervisorAll) {
  stop(guard);
  stop(pilot);
  stop(far_chief);
  EXPECT_EQ(clear_stop(pilot), 200);
  EXPECT_EQ(stoppers(), "Org1MSP CN=guard, Org3MSP CN=far");
  EXPECT_THAT(
      stub.call(pilot, "clear_stop", {"tello1"}).message,
      StartsWith("tello1: stopped by Org1MSP CN=guard, Org3MSP CN=far; only they, each its own, or a supervisor "
                 "of Org1MSP may clear it"));
  EXPECT_EQ(clear_stop(chief), 200);
  EXPECT_THAT(stoppers(), IsEmpty());
  EXPECT_THAT(stub.call(chief, "clear_stop", {"tello1"}).message, StartsWith("tello1: not stopped"));
}

TEST_F(StopTest, AStopsRecordStaysAndItsClearsAreCountedBesideIt) {
  stop(guard);
  clear_stop(guard);
  const auto records = parsed<Assets>(stub.call(other, "get", {"stop/tello1/*"}).payload);
  ASSERT_EQ(records.assets_size(), 2);
  const auto record = parsed<Stop>(records.assets(0).msg_data());
  EXPECT_EQ(record.stopper().subject(), "CN=guard");
  EXPECT_EQ(record.clears(), 0U);
  const auto cleared = parsed<Stop>(records.assets(1).msg_data());
  EXPECT_TRUE(cleared.cleared());
  EXPECT_EQ(cleared.stopper().subject(), "CN=guard");
  EXPECT_EQ(cleared.clears(), 1U);
  EXPECT_EQ(stop(guard), 200);
  EXPECT_EQ(stoppers(), "Org1MSP CN=guard") << "and stops again";
  EXPECT_EQ(control("tello1").stoppers(0).clears(), 1U);
  EXPECT_EQ(clear_stop(chief), 200);
  EXPECT_EQ(clears_of(control("tello1"), control("tello1").cleared(0).stopper()), 2U);
}

TEST_F(StopTest, AStopForAnotherCountIsRefusedAndSaysTheCount) {
  DronesCall call;
  call.add_drones("tello2");
  call.add_drones("tello1");
  call.add_clears(0);
  call.add_clears(0);
  EXPECT_EQ(stub.call(guard, "stop", call).status, 200);
  clear_stop(guard);
  EXPECT_EQ(stub.call(guard, "stop", call).message,
            "tello1: a stop meant for 0 clears of the stops of Org1MSP CN=guard; the ledger has 1: name that, or none");
  call.set_clears(1, 1);
  EXPECT_EQ(stub.call(guard, "stop", call).status, 200) << "in the order of its drones";
  call.add_clears(0);
  EXPECT_EQ(stub.call(guard, "stop", call).message, "stop: 3 clears for 2 drones");
}

TEST_F(StopTest, AnOldRecordThatSaysClearedIsNoStop) {
  Stop old;
  old.set_drone("tello1");
  old.mutable_stopper()->set_msp_id(guard.msp_id);
  old.mutable_stopper()->set_subject(guard.subject);
  old.set_cleared(true);
  const auto put = [&] {
    stub.who = guard;
    ASSERT_TRUE(write_stop(stub, old));
    for (const auto& [key, value] : stub.writes) stub.state[key] = value;
  };
  put();
  EXPECT_THAT(stoppers(), IsEmpty());
  old.set_cleared(false);
  put();
  EXPECT_EQ(stoppers(), "Org1MSP CN=guard");
  EXPECT_EQ(clear_stop(guard), 200);
  EXPECT_THAT(stoppers(), IsEmpty());
}

TEST_F(StopTest, AStoppersNewestStopDecidesWhetherItCuts) {
  stop(guard);
  EXPECT_FALSE(is_cut(control("tello1")));
  cut(guard);
  EXPECT_TRUE(is_cut(control("tello1")));
  stop(chief);
  EXPECT_TRUE(is_cut(control("tello1"))) << "another's weaker stop takes nothing back";
  stop(guard);
  EXPECT_FALSE(is_cut(control("tello1"))) << "the ledger alone: agent and link hold on to a cut in flight";
}

TEST_F(StopTest, AStopReadsWhatNobodyWritesWhoFliesAndWritesOneKeyOfItsOwn) {
  for (const auto& who : {chief, guard, far_chief, pilot}) {
    ASSERT_EQ(stop(who), 200);
    EXPECT_THAT(stub.reads, Not(Contains(StartsWith("control/"))));
    EXPECT_THAT(stub.reads, Not(Contains(StartsWith("lease/"))));
    // But for how often its own were cleared, which nobody writes while none of its own stands.
    EXPECT_THAT(stub.reads, Not(Contains(AllOf(StartsWith("stop/"), Not(EndsWith("/lifted"))))));
    EXPECT_THAT(stub.ranges, IsEmpty());
    ASSERT_EQ(stub.writes.size(), 1U);
    EXPECT_THAT(stub.writes.begin()->first, StartsWith("stop/tello1/"));
  }
}

TEST_F(StopTest, WhoChangesAControlRecordReadsTheStopsAsARange) {
  LeaseCall lease;
  lease.add_drones("tello1");
  stop(pilot);
  for (const char* function : {"clear_stop", "acquire", "release"}) {
    ASSERT_EQ(stub.call(pilot, function, lease).status, 200) << function;
    EXPECT_THAT(stub.ranges, ElementsAre("stop/tello1/")) << function;
  }
}

TEST_F(StopTest, EventAndAnswerOfAStopAreTheStopsThatItMade) {
  DronesCall call;
  call.add_drones("tello2");
  call.add_drones("tello1");
  call.add_drones("tello2");
  const Response answer = stub.call(guard, "stop", call);
  EXPECT_EQ(stub.event_name, "stop");
  EXPECT_EQ(stub.event_payload, answer.payload);
  const auto stops = parsed<Stops>(answer.payload);
  ASSERT_EQ(stops.stops_size(), 2) << "one a drone";
  for (const Stop& one : stops.stops()) {
    EXPECT_EQ(one.stopper().subject(), guard.subject);
    EXPECT_FALSE(one.cut());
    EXPECT_FALSE(one.cleared());
  }
  EXPECT_EQ(stops.stops(0).drone(), "tello1");
  EXPECT_EQ(stops.stops(1).drone(), "tello2");
}

TEST_F(StopTest, AStopKeepsTheLease) {
  const auto epoch = control("tello1").epoch();
  stop(pilot);
  EXPECT_EQ(control("tello1").holder().subject(), "CN=pilot");
  EXPECT_EQ(control("tello1").epoch(), epoch);
}

TEST_F(StopTest, OnceStopsAreAppliedTheContractTakesOnlyLanding) {
  stop(pilot);
  EXPECT_EQ(command().status, 200) << "the lease does not know yet; agent refuses it";
  EXPECT_EQ(stub.call(host, "apply_stops", {"tello1"}).status, 200);
  EXPECT_EQ(stub.event_name, "apply_stops");
  EXPECT_THAT(command().message, HasSubstr("stopped by Org2MSP CN=pilot"));
  EXPECT_EQ(command(LAND).status, 200);
  clear_stop(pilot);
  EXPECT_EQ(command().status, 200);
}

TEST_F(StopTest, TheDronesHostAloneAppliesStopsAndOnlyWhatChangesIsWritten) {
  for (const auto& who : {pilot, chief, guard, admin1, other}) {
    EXPECT_THAT(stub.call(who, "apply_stops", {"tello1"}).message,
                StartsWith("tello1: enrolled to Org1MSP CN=host, who alone applies its stops"));
  }
  EXPECT_EQ(stub.call(host, "apply_stops", {"tello1", "tello2"}).status, 200);
  EXPECT_THAT(stub.writes, IsEmpty());
  stop(guard);
  EXPECT_EQ(stub.call(host, "apply_stops", {"tello1", "tello2"}).status, 200);
  ASSERT_EQ(stub.writes.size(), 1U);
  EXPECT_THAT(stub.writes.begin()->first, StartsWith("lease/"));
  EXPECT_EQ(stub.call(host, "apply_stops", {"tello1"}).status, 200);
  EXPECT_THAT(stub.writes, IsEmpty());
  const auto event = parsed<Controls>(stub.event_payload);
  ASSERT_EQ(event.controls_size(), 1);
  EXPECT_EQ(stopper_names(event.controls(0)), "Org1MSP CN=guard");
}

TEST_F(StopTest, ALeaseThatIsTakenWhileStopsStandIsStopped) {
  stop(guard);
  LeaseCall lease;
  lease.add_drones("tello1");
  stub.call(pilot, "release", lease);
  EXPECT_EQ(stub.call(pilot, "acquire", lease).status, 200);
  EXPECT_THAT(command().message, HasSubstr("stopped by Org1MSP CN=guard"));
}

TEST_F(StopTest, EveryReaderOfAControlRecordFindsItsStops) {
  stop(guard);
  EXPECT_EQ(stoppers(), "Org1MSP CN=guard");
  const auto page = parsed<Assets>(stub.call(other, "get", {"control/*"}).payload);
  ASSERT_EQ(page.assets_size(), 2);
  EXPECT_TRUE(is_stopped(parsed<Control>(page.assets(0).msg_data())));
  EXPECT_FALSE(is_stopped(parsed<Control>(page.assets(1).msg_data())));
  const auto enrolled = parsed<Controls>(enroll(admin1, host, {"tello1"}, ROLE_NONE).payload);
  EXPECT_TRUE(is_stopped(enrolled.controls(0)));
}

TEST_F(StopTest, MoreStoppersThanOneReadGivesAreAllFound) {
  for (int i = 0; i < 150; ++i) {
    const crypto::IdentityName one{"Org1MSP", "CN=guard" + std::to_string(i)};
    enroll(admin1, one, {}, OPERATOR);
    ASSERT_EQ(stop(one), 200);
  }
  EXPECT_EQ(control("tello1").stoppers_size(), 150);
  EXPECT_EQ(clear_stop(chief), 200);
  EXPECT_EQ(control("tello1").stoppers_size(), 0);
}

TEST_F(StopTest, ADronesOwnerRecordIsWrittenOnce) {
  const auto organisation = parsed<Organisation>(value_of("owner/tello1"));
  EXPECT_EQ(organisation.msp_id(), "Org1MSP");
  EXPECT_EQ(enroll(admin1, {"Org1MSP", "CN=host2"}, {"tello1"}, ROLE_NONE).status, 200);
  EXPECT_EQ(stub.writes.count("owner/tello1"), 0U);
}

}  // namespace
}  // namespace ledgerline::chaincode
