#include "tools/launcher/preflight.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::launcher {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

Options options_of(int drones) {
  Options options;
  options.own.emplace();
  options.own->pose_source = "mocap";
  options.own->link.fence.min_m = {-2, -2, 0};
  options.own->link.fence.max_m = {2, 2, 2};
  for (int k = 1; k <= drones; ++k)
    options.own->drones.push_back({fmt::format("d{}", k), fmt::format("10.0.0.{}", k), k == 2 ? "wlan1" : "", ""});
  options.drones = drones;
  return options;
}

std::string line_of(const std::string& name, const std::string& phase, const std::string& cause,
                    const std::string& pose_age_ms = "12.0", double x_m = 0) {
  return fmt::format(
      R"({{"link":{{"drones":[{{"name":"{}","phase":"{}","mode":"none","cause":"{}","battery":0.87,"pose_age_ms":{},)"
      R"("position":[{},0.5,0.1]}}]}}}})",
      name, phase, cause, pose_age_ms, x_m);
}

TEST(Preflight, EveryDroneMustBeReady) {
  Preflight preflight(options_of(2));
  EXPECT_FALSE(preflight.ready());
  preflight.on_status(line_of("d1", "on_ground", "none"));
  EXPECT_FALSE(preflight.ready());
  EXPECT_THAT(preflight.ready().error().message,
              AllOf(StartsWith("d2's drone: 10.0.0.2 behind wlan1: the drone does not answer (cure: switch"),
                    Not(HasSubstr("d1"))));
  preflight.on_status(line_of("d2", "landed", "none"));
  EXPECT_TRUE(preflight.ready());
  EXPECT_TRUE(preflight.can_become_ready());
  preflight.on_status(line_of("d1", "on_ground", "pose_lost", "null"));
  EXPECT_FALSE(preflight.ready());
  EXPECT_TRUE(preflight.can_become_ready()) << "motion capture may see it in a moment";
  preflight.on_status(line_of("d1", "on_ground", "battery_low"));
  EXPECT_FALSE(preflight.ready());
  EXPECT_FALSE(preflight.can_become_ready());
}

TEST(Preflight, TheListHasWhatAPersonChecks) {
  Preflight preflight(options_of(2));
  preflight.on_status(line_of("d2", "on_ground", "none"));
  const std::string list = preflight.list();
  EXPECT_THAT(list, HasSubstr("broken   drone       drone_silent: d1: 10.0.0.1 (the drone does not answer)"));
  EXPECT_THAT(list, HasSubstr("ok       drone       d2: 10.0.0.2 behind wlan1"));
  EXPECT_THAT(list, HasSubstr("ok       battery     d2: 87 %"));
  EXPECT_THAT(list, HasSubstr("ok       pose        d2: mocap, 12 ms old: 0.00, 0.50, 0.10 m"));
  EXPECT_THAT(list, HasSubstr("ok       fence       x -2 to 2, y -2 to 2, z 0 to 2 m"));
}

TEST(Preflight, TheReasonWhyADroneIsNotReadyIsReported) {
  Preflight preflight(options_of(1));
  const auto why = [&](const std::string& line) {
    preflight.on_status(line);
    return preflight.ready().error().message;
  };
  EXPECT_THAT(why(line_of("d1", "on_ground", "pose_lost", "null")), HasSubstr("agent has accepted no pose from mocap"));
  EXPECT_THAT(why(line_of("d1", "on_ground", "pose_lost", "900")), HasSubstr("d1's pose: mocap, 900 ms old"));
  EXPECT_THAT(why(line_of("d1", "on_ground", "battery_low")), HasSubstr("d1's battery: 87 %"));
  EXPECT_THAT(why(line_of("d1", "on_ground", "stopped")), HasSubstr("d1's link: stopped: link refuses a take-off"));
  EXPECT_THAT(why(line_of("d1", "flying", "none")), HasSubstr("d1's link: flying: the drone is not on the ground"));
}

TEST(Preflight, AnotherDroneAtItsAddressAndAFirewallAreReported) {
  Options options = options_of(2);
  options.own->drones[0].serial = "A123";
  Preflight preflight(options);
  const auto hear = [&](const char* name, const char* more) {
    preflight.on_status(fmt::format(
        R"({{"link":{{"drones":[{{"name":"{}","phase":"on_ground","cause":"none","battery":0.87,"pose_age_ms":12,)"
        R"("position":[0,0.5,0],{}}}]}}}})",
        name, more));
  };
  hear("d1", R"("serial":null,"diverted":false)");
  hear("d2", R"("serial":null,"diverted":false)");
  EXPECT_FALSE(preflight.ready()) << "it has not yet said which drone it is";
  hear("d1", R"("serial":"B456","diverted":false)");
  EXPECT_THAT(preflight.ready().error().message, HasSubstr("10.0.0.1 says serial B456, not A123"));
  hear("d1", R"("serial":"","diverted":false)");
  EXPECT_TRUE(preflight.ready()) << "its firmware reports none";
  hear("d1", R"("serial":"A123","diverted":false)");
  EXPECT_TRUE(preflight.ready());
  hear("d2", R"("serial":null,"diverted":true)");
  EXPECT_THAT(preflight.ready().error().message, HasSubstr("none at 0.0.0.0:8890"));
}

TEST(Preflight, WithoutAnyPoseAPilotsDroneIsReady) {
  Options options = options_of(1);
  options.own->pose_source = "none";
  options.manual = true;
  Preflight preflight(options);
  preflight.on_status(line_of("d1", "on_ground", "battery_low", "null"));
  EXPECT_FALSE(preflight.ready());
  preflight.on_status(line_of("d1", "on_ground", "pose_lost", "null"));
  EXPECT_TRUE(preflight.ready()) << preflight.ready().error().message;
  EXPECT_THAT(preflight.list(), HasSubstr("none: it is flown by hand"));
  EXPECT_THAT(preflight.list(), HasSubstr("z 0 to 2 m: of these the ceiling alone holds"));
}

TEST(Preflight, WhatIsNoStatusLineChangesNothing) {
  Preflight preflight(options_of(1));
  for (const char* line : {"", "[1]", "{}", R"({"link":3})", R"({"link":{"drones":[1,{"name":7}]}})",
                           R"({"agent":{"drones":[{"name":"d1","phase":"on_ground","cause":"none"}]}})"})
    preflight.on_status(line);
  EXPECT_THAT(preflight.ready().error().message, HasSubstr("does not answer"));
}

TEST(Preflight, APathIsCheckedFromWhereTheDroneStands) {
  Options options = options_of(1);
  options.side_m = 1.5;
  Preflight preflight(options);
  preflight.on_status(line_of("d1", "on_ground", "none", "12.0", 0));
  EXPECT_TRUE(preflight.path_fits());
  preflight.on_status(line_of("d1", "on_ground", "none", "12.0", 1.0));
  const Status status = preflight.path_fits();
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, HasSubstr("d1 would be at 2.5, 0.5, 1 m, beyond link's fence"));
}

TEST(Preflight, WarnsWhereNothingSaysWhetherBlocksComeInTime) {
  Options options = options_of(1);
  deployment::OwnLedger& network = options.own->network.emplace();
  network.agent = "[ledger]\n";
  network.ground = "[ledger]\ntimeouts = \"auto\"\n";
  const Preflight preflight(options);
  EXPECT_TRUE(preflight.blocks_fit());
  EXPECT_THAT(preflight.list(), AllOf(HasSubstr("anchor_missing: the file of ledger.agent: whether its blocks"),
                                      Not(HasSubstr("the file of ledger.ground"))));
}

TEST(Preflight, TheHolderOfADroneIsReportedBeforeItIsAcquired) {
  Preflight preflight(options_of(1));
  const crypto::IdentityName self{"Org2MSP", "CN=pilot"};
  preflight.on_status(line_of("d1", "on_ground", "none"));
  const auto fits = [&](const std::string& more) {
    EXPECT_TRUE(preflight.read_records(R"({"controls":[{"drone":"d1")" + more + "}]}", self));
    return preflight.leases_fit();
  };
  EXPECT_TRUE(fits(""));
  EXPECT_FALSE(preflight.is_held("d1"));
  EXPECT_TRUE(fits(R"(,"holder":{"mspId":"Org2MSP","subject":"CN=pilot"})"));
  EXPECT_TRUE(preflight.is_held("d1")) << "ours before the flight, and behind it";
  EXPECT_TRUE(fits(R"(,"stoppers":[{"stopper":{"mspId":"Org1MSP","subject":"CN=host"}}])"));  // link waits for its end
  const Status other = fits(R"(,"holder":{"mspId":"Org3MSP","subject":"CN=pilot"})");
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().message,
              HasSubstr("d1's lease: held by Org3MSP CN=pilot, priority 0: somebody else holds"));
  EXPECT_FALSE(preflight.ready());
  EXPECT_TRUE(preflight.acquires("d1"));
  preflight.acquired();
  EXPECT_TRUE(preflight.ready());
  EXPECT_THAT(preflight.list(), HasSubstr("lease       d1: ours"));
}

TEST(Preflight, TakesWhoHoldsADroneFromItsRecord) {
  checks::PreflightInputs inputs;
  for (const char* name : {"d1", "d2"}) inputs.drones.push_back({.name = name, .address = "10.0.0.1"});
  const auto take = [&](const std::string& line) { return read_records(line, {"Org2MSP", "CN=pilot"}, inputs).ok(); };
  ASSERT_TRUE(take(R"({"controls":[{"drone":"d1","holder":{"mspId":"Org3MSP","subject":"CN=h\u001b"}},)"
                   R"({"drone":"d2","holder":{"mspId":"Org2MSP","subject":"CN=pilot"}}]})"));
  EXPECT_THAT(words(assess(inputs)), AllOf(HasSubstr("d1: held by Org3MSP CN=h?"), HasSubstr("d2: ours\n")));
  ASSERT_TRUE(take(R"({"controls":[{"drone":"d2"}]})"));
  EXPECT_FALSE(inputs.drones[0].lease->control);
  EXPECT_FALSE(inputs.drones[1].lease->control->has_holder());
  for (const char* other : {"", "[]", "no", R"({"controls":7})"}) EXPECT_FALSE(take(other)) << other;
  EXPECT_TRUE(inputs.drones[1].lease->control);
  ASSERT_TRUE(take("{}"));  // a ledger without any record
  EXPECT_FALSE(inputs.drones[1].lease->control);
}

TEST(Preflight, AHolderWhoLetsUsCommandIsNotAskedForTheLease) {
  Preflight preflight(options_of(1));
  const crypto::IdentityName station{"Org2MSP", "CN=station"}, pilot{"Org2MSP", "CN=pilot"};
  preflight.on_status(line_of("d1", "on_ground", "none"));
  const char* record = R"({"controls":[{"drone":"d1","holder":{"mspId":"Org2MSP","subject":"CN=pilot"},)"
                       R"("delegate":{"mspId":"Org2MSP","subject":"CN=station"}}]})";
  EXPECT_TRUE(preflight.read_records(record, station));
  EXPECT_TRUE(preflight.leases_fit());
  EXPECT_FALSE(preflight.acquires("d1"));
  preflight.acquired();
  EXPECT_THAT(preflight.list(), HasSubstr("lease       d1: ours to command: held by Org2MSP CN=pilot"));
  EXPECT_TRUE(preflight.read_records(record, pilot));
  EXPECT_FALSE(preflight.leases_fit()) << "who lets another command flies it no more than anybody";
}

TEST(Preflight, TheListHasThePathWhereItLeavesTheFence) {
  Options options = options_of(1);
  options.side_m = 3;
  Preflight preflight(options);
  preflight.on_status(line_of("d1", "on_ground", "none", "12.0", 0));
  EXPECT_TRUE(preflight.ready());  // to stand there
  EXPECT_THAT(preflight.list(), HasSubstr("path_beyond_fence: square with --side 3: d1 would be at 3, 0.5, 1 m"));
}

}  // namespace
}  // namespace ledgerline::launcher
