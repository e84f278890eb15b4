#include <gmock/gmock.h>

#include <limits>

#include "common/msg/contract.hpp"
#include "tests/unit/chaincode/contract/fake_stub.hpp"

namespace ledgerline::chaincode {
namespace {

using ::testing::HasSubstr;
using ::testing::SizeIs;
using ::testing::StartsWith;

class ControlTest : public ContractTest {
 protected:
  Response acquire(const crypto::IdentityName& by, const std::vector<std::string>& drones, std::uint32_t priority = 0) {
    LeaseCall call;
    for (const std::string& drone : drones) call.add_drones(drone);
    call.set_priority(priority);
    return stub.call(by, "acquire", call);
  }

  DronePlan plan(const std::string& drone, int setpoints = 3) {
    DronePlan plan;
    plan.set_drone(drone);
    plan.set_epoch(control(drone).epoch());
    for (int i = 0; i < setpoints; ++i) plan.add_setpoints()->set_at_ns(1000 + i * 50 * ns_per_ms);
    return plan;
  }

  Response command(const crypto::IdentityName& by, const std::vector<DronePlan>& plans) {
    CommandCall call;
    call.set_organisation("Org1MSP");
    for (const DronePlan& one : plans) *call.add_plans() = one;
    return stub.call(by, "command", call);
  }
};

TEST_F(ControlTest, OnlyAnAdministratorOfTheIdentitysOrganisationEnrolls) {
  EXPECT_THAT(enroll(host, host, {"tello5"}, ROLE_NONE).message, HasSubstr("only an administrator of Org1MSP"));
  EXPECT_THAT(enroll(admin2, host, {"tello5"}, ROLE_NONE).message, HasSubstr("only an administrator of Org1MSP"));
  EXPECT_EQ(enroll(admin1, host, {"tello5"}, ROLE_NONE).status, 200);
  EXPECT_EQ(control("tello5").owner().subject(), "CN=host");
}

TEST_F(ControlTest, ADroneOfAnotherOrganisationCannotBeTaken) {
  EXPECT_THAT(enroll(admin2, pilot, {"tello1"}, ROLE_NONE).message,
              StartsWith("tello1: enrolled to organisation Org1MSP already"));
}

TEST_F(ControlTest, EnrollingTheSameAgainIsAcceptedAndChangesNothing) {
  acquire(pilot, {"tello1"});
  EXPECT_EQ(enroll(admin1, host, {"tello1", "tello2"}, ROLE_NONE).status, 200);
  EXPECT_TRUE(stub.writes.empty());
  EXPECT_EQ(control("tello1").holder().subject(), "CN=pilot");
  EXPECT_EQ(enroll(admin2, pilot, {}, OPERATOR).status, 200);
  EXPECT_TRUE(stub.writes.empty());
}

TEST_F(ControlTest, EnrollingRecordsWhoAndWhat) {
  enroll(admin1, host, {"tello5"}, OPERATOR);
  EXPECT_EQ(stub.event_name, "enroll");
  const auto event = parsed<Controls>(stub.event_payload);
  ASSERT_THAT(event.controls(), SizeIs(1));
  EXPECT_EQ(event.controls(0).drone(), "tello5");
  EXPECT_EQ(event.identity().subject(), "CN=host");
  EXPECT_EQ(event.role(), OPERATOR);
}

TEST_F(ControlTest, NamesOfOrganisationsAndReservedWordsAreNoDrones) {
  for (const char* name : {"Org2MSP", "control", "asset", "frame", "lease", "host", "stop", "owner", "grant", "drones",
                           "a/b", "", ".", ".."}) {
    EXPECT_NE(enroll(admin1, host, {name}, ROLE_NONE).status, 200) << name;
  }
}

TEST_F(ControlTest, NoDroneHasANameThatRosOrMocapNeeds) {
  for (const std::string_view name : contract::reserved_names) {
    EXPECT_THAT(enroll(admin1, host, {std::string(name)}, ROLE_NONE).message, HasSubstr("needs this name")) << name;
  }
  EXPECT_EQ(enroll(admin1, host, {"tf2"}, ROLE_NONE).status, 200);
}

TEST_F(ControlTest, ANewDroneHasANameThatRosTakesAsATopicsToken) {
  for (const char* name : {"1tello", "tello-1", "tello.1", "tello__1", "_tello"}) {
    EXPECT_THAT(enroll(admin1, host, {name}, ROLE_NONE).message, HasSubstr(contract::drone_name_rule)) << name;
  }
  for (const char* name : {"t", "Tello_1", "tello1_"}) EXPECT_EQ(enroll(admin1, host, {name}, ROLE_NONE).status, 200);
}

TEST_F(ControlTest, ANameOfBeforeThatRosDoesNotTakeStaysUsable) {
  const std::string name = "tello3_a", of_before = "tello3-a";
  ASSERT_EQ(enroll(admin1, host, {name}, ROLE_NONE).status, 200);
  std::map<std::string, std::string> renamed;
  const auto rename = [&](std::string text) {
    for (std::size_t at; (at = text.find(name)) != std::string::npos;) text.replace(at, name.size(), of_before);
    return text;
  };
  for (const auto& [key, value] : stub.state) renamed[rename(key)] = rename(value);
  stub.state = renamed;
  EXPECT_EQ(enroll(admin1, guard, {of_before}, ROLE_NONE).status, 200) << "of another host";
  EXPECT_EQ(acquire(chief, {of_before}).status, 200);
}

TEST_F(ControlTest, AnOrganisationEnrollsAsManyNamesAsTheBoundSays) {
  std::vector<std::string> names;
  for (std::size_t i = 2; i < contract::max_organisation_drones; ++i) names.push_back("more" + std::to_string(i));
  EXPECT_EQ(enroll(admin1, host, names, ROLE_NONE).status, 200);
  EXPECT_THAT(enroll(admin1, guard, {"one"}, ROLE_NONE).message, StartsWith("one: Org1MSP has 256 drones already"));
  EXPECT_EQ(enroll(admin1, guard, {"tello1"}, ROLE_NONE).status, 200) << "none is new";
  EXPECT_EQ(enroll(admin2, pilot, {"one"}, ROLE_NONE).status, 200) << "of another organisation";
}

TEST_F(ControlTest, OnlyOperatorsAndSupervisorsAcquire) {
  EXPECT_THAT(acquire(host, {"tello1"}).message, HasSubstr("neither operator nor supervisor"));
  EXPECT_EQ(acquire(pilot, {"tello1"}).status, 200);
  EXPECT_EQ(acquire(chief, {"tello2"}).status, 200);
  EXPECT_THAT(acquire(pilot, {"tello9"}).message, StartsWith("tello9: not enrolled"));
}

TEST_F(ControlTest, ALeaseIsHeldUntilAHigherPriorityComes) {
  EXPECT_EQ(acquire(pilot, {"tello1"}, 1).status, 200);
  EXPECT_THAT(acquire(rival, {"tello1"}, 1).message, StartsWith("tello1: the lease is held by Org2MSP CN=pilot"));
  EXPECT_EQ(acquire(rival, {"tello1"}, 2).status, 200);
  EXPECT_EQ(control("tello1").holder().subject(), "CN=rival");
}

TEST_F(ControlTest, TheEpochGrowsWithEveryChangeOfHolderAndOnlyThen) {
  const auto first = parsed<Controls>(acquire(pilot, {"tello1"}).payload).controls(0).epoch();
  EXPECT_EQ(parsed<Controls>(acquire(pilot, {"tello1"}).payload).controls(0).epoch(), first);
  EXPECT_TRUE(stub.writes.empty()) << "the same holder again changes nothing";
  const auto second = parsed<Controls>(acquire(rival, {"tello1"}, 1).payload).controls(0).epoch();
  EXPECT_GT(second, first);
  stub.call(rival, "release", {"tello1"});
  acquire(rival, {"tello1"});
  EXPECT_GT(control("tello1").epoch(), second);
}

TEST_F(ControlTest, OnlyTheHolderReleases) {
  acquire(pilot, {"tello1"});
  EXPECT_THAT(stub.call(rival, "release", {"tello1"}).message, StartsWith("tello1: "));
  EXPECT_EQ(stub.call(pilot, "release", {"tello1"}).status, 200);
  EXPECT_FALSE(control("tello1").has_holder());
  EXPECT_EQ(acquire(rival, {"tello1"}).status, 200);
}

TEST_F(ControlTest, PlainStringsAreDronesAndOptions) {
  EXPECT_EQ(stub.call(pilot, "acquire", {"tello1", "tello2", "priority=7"}).status, 200);
  EXPECT_EQ(stub.event_payload.front(), '{');
  EXPECT_THAT(parsed<Controls>(stub.event_payload).controls(), SizeIs(2));
  EXPECT_EQ(control("tello2").priority(), 7U);
  EXPECT_NE(stub.call(pilot, "acquire", {"tello1", "priority=x"}).status, 200);
  EXPECT_NE(stub.call(pilot, "acquire", std::vector<std::string>()).status, 200);
}

TEST_F(ControlTest, TheHoldersCommandIsWrittenBlindlyAndAnnounced) {
  acquire(pilot, {"tello1", "tello2"});
  const std::vector<DronePlan> plans{plan("tello1"), plan("tello2")};
  EXPECT_EQ(command(pilot, plans).status, 200);
  EXPECT_EQ(stub.event_name, "command");
  EXPECT_THAT(parsed<CommandCall>(stub.event_payload).plans(), SizeIs(2));
  for (const auto& [key, value] : stub.writes) {
    EXPECT_THAT(key, StartsWith("command/"));
    EXPECT_THAT(stub.reads, ::testing::Not(::testing::Contains(key)));
  }
}

TEST_F(ControlTest, OneReadTellsWhoFliesTheDronesThatWereAcquiredTogether) {
  acquire(rival, {"tello2"});
  stub.call(rival, "release", {"tello2"});  // its epoch is ahead of tello1's
  acquire(pilot, {"tello1", "tello2"});
  EXPECT_EQ(command(pilot, {plan("tello1"), plan("tello2")}).status, 200);
  EXPECT_THAT(stub.reads, ::testing::ElementsAre(StartsWith("lease/")));
}

TEST_F(ControlTest, TakingOrStoppingADroneWritesWhatTheHoldersCommandsRead) {
  // So on a ledger the commands of the old holder that are on their way are invalid (MVCC).
  acquire(pilot, {"tello1", "tello2"});
  const DronePlan one = plan("tello1"), two = plan("tello2");
  EXPECT_EQ(command(pilot, {one, two}).status, 200);
  const std::string read = stub.reads.front();
  acquire(rival, {"tello2"}, 1);
  EXPECT_TRUE(stub.writes.contains(read));
  EXPECT_THAT(command(pilot, {one, two}).message, StartsWith("tello2: the lease is held by Org2MSP CN=rival"));
  EXPECT_EQ(command(pilot, {one}).status, 200);
  stub.call(guard, "stop", {"tello1"});
  stub.call(host, "apply_stops", {"tello1"});
  EXPECT_TRUE(stub.writes.contains(read));
  EXPECT_THAT(command(pilot, {one}).message, StartsWith("tello1: stopped by Org1MSP CN=guard"));
  stub.call(guard, "clear_stop", {"tello1"});
  EXPECT_EQ(command(pilot, {one}).status, 200);
  stub.call(pilot, "release", {"tello1"});
  EXPECT_TRUE(stub.writes.contains(read));
  EXPECT_THAT(command(pilot, {one}).message, StartsWith("tello1: the lease is held by nobody"));
}

TEST_F(ControlTest, AFightOverOneDroneWritesNothingThatItsNeighboursRead) {
  acquire(pilot, {"tello1", "tello2"});
  const DronePlan one = plan("tello1");
  EXPECT_EQ(command(pilot, {one}).status, 200);
  const std::string read = stub.reads.front();
  acquire(rival, {"tello2"}, 1);
  for (std::uint32_t priority = 2; priority < 6; ++priority) {
    EXPECT_EQ(acquire(priority % 2 == 0 ? pilot : rival, {"tello2"}, priority).status, 200);
    EXPECT_FALSE(stub.writes.contains(read));
    EXPECT_EQ(command(priority % 2 == 0 ? pilot : rival, {plan("tello2")}).status, 200);
  }
  EXPECT_EQ(set(host, {asset("tello1/odom")}, true).status, 200);
  EXPECT_THAT(stub.reads, ::testing::ElementsAre(StartsWith("host/")));
  EXPECT_EQ(command(pilot, {one}).status, 200);
}

TEST_F(ControlTest, AStoppedDroneStaysStoppedWithANewHolder) {
  acquire(pilot, {"tello1"});
  stub.call(guard, "stop", {"tello1"});
  acquire(rival, {"tello1"}, 1);
  EXPECT_THAT(command(rival, {plan("tello1")}).message, HasSubstr("stopped by Org1MSP CN=guard"));
  stub.call(guard, "clear_stop", {"tello1"});
  EXPECT_EQ(command(rival, {plan("tello1")}).status, 200);
}

TEST_F(ControlTest, AnyoneElsesCommandIsRefusedWithTheHolder) {
  EXPECT_THAT(command(pilot, {plan("tello1")}).message, StartsWith("tello1: the lease is held by nobody"));
  acquire(pilot, {"tello1"});
  EXPECT_THAT(command(rival, {plan("tello1")}).message, StartsWith("tello1: the lease is held by Org2MSP CN=pilot"));
  EXPECT_THAT(command(host, {plan("tello1")}).message, StartsWith("tello1: the lease is held by Org2MSP CN=pilot"));
}

TEST_F(ControlTest, ARefusalForOneDroneBeginsWithItsName) {
  acquire(pilot, {"tello1"});
  EXPECT_THAT(command(pilot, {plan("tello1"), plan("tello2")}).message, StartsWith("tello2: "));
}

TEST_F(ControlTest, ACommandOfAnOldEpochIsRefused) {
  acquire(pilot, {"tello1"});
  const DronePlan old = plan("tello1");
  acquire(rival, {"tello1"}, 1);
  acquire(pilot, {"tello1"}, 2);
  EXPECT_THAT(command(pilot, {old}).message, HasSubstr("epoch"));
}

TEST_F(ControlTest, PlansHaveLimitsAndFiniteValues) {
  acquire(pilot, {"tello1"});
  EXPECT_EQ(command(pilot, {plan("tello1", contract::max_plan_setpoints)}).status, 200);
  EXPECT_THAT(command(pilot, {plan("tello1", contract::max_plan_setpoints + 1)}).message, HasSubstr("the limit is 40"));
  EXPECT_THAT(command(pilot, {plan("tello1", 0)}).message, HasSubstr("no setpoints"));
  EXPECT_THAT(command(pilot, {plan("tello1"), plan("tello1")}).message, StartsWith("tello1: two plans"));
  EXPECT_NE(command(pilot, {}).status, 200);

  DronePlan horizon = plan("tello1", 2);
  horizon.mutable_setpoints(1)->set_at_ns(1000 + contract::max_plan_ns);
  EXPECT_EQ(command(pilot, {horizon}).status, 200);
  horizon.mutable_setpoints(1)->set_at_ns(1001 + contract::max_plan_ns);
  EXPECT_THAT(command(pilot, {horizon}).message, HasSubstr("the limit is 2000 ms"));

  DronePlan backwards = plan("tello1", 2);
  backwards.mutable_setpoints(1)->set_at_ns(1);
  EXPECT_THAT(command(pilot, {backwards}).message, HasSubstr("backwards"));
  DronePlan extreme = plan("tello1", 2);
  extreme.mutable_setpoints(0)->set_at_ns(std::numeric_limits<std::int64_t>::min());
  extreme.mutable_setpoints(1)->set_at_ns(std::numeric_limits<std::int64_t>::max());
  EXPECT_NE(command(pilot, {extreme}).status, 200);

  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    DronePlan wrong = plan("tello1");
    wrong.mutable_setpoints(1)->set_yaw_rate(bad);
    EXPECT_THAT(command(pilot, {wrong}).message, HasSubstr("not finite"));
    DronePlan nowhere = plan("tello1");
    nowhere.mutable_setpoints(1)->mutable_reference()->set_ay(bad);
    EXPECT_THAT(command(pilot, {nowhere}).message, HasSubstr("not finite"));
  }

  DronePlan tracked = plan("tello1");
  tracked.mutable_setpoints(0)->mutable_reference()->set_x(1);
  tracked.mutable_response()->set_gain(1);
  tracked.mutable_response()->set_lag_s(0.2F);
  EXPECT_EQ(command(pilot, {tracked}).status, 200);
  tracked.mutable_response()->set_lag_s(0);
  EXPECT_THAT(command(pilot, {tracked}).message, HasSubstr("the response is no drone's"));
  tracked.clear_response();
  tracked.set_body_frame(true);
  EXPECT_THAT(command(pilot, {tracked}).message, HasSubstr("in the drone's frame has a reference"));
}

}  // namespace
}  // namespace ledgerline::chaincode
