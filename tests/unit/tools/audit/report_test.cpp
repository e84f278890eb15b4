#include "tools/audit/report.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "common/msg/ros.hpp"
#include "peer/transaction.pb.h"
#include "tests/unit/tools/audit/signed_ledger.hpp"
#include "tools/audit/chain_audit.hpp"

namespace ledgerline::audit {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const std::string pilot_name = "Org2MSP/client.Org2MSP", admin_name = "Org1MSP/admin.Org1MSP";

class ReportTest : public ::testing::Test {
 protected:
  ReportTest() { ledger.enroll(); }

  const DroneReport& reported() {
    audit = std::make_unique<ChainAudit>(audited(ledger.chain, ledger.trust()));
    EXPECT_THAT(audit->findings(), IsEmpty()) << to_text(audit->findings().front());
    return audit->report().drones().at("tello1");
  }
  static void add(SetCall& call, const std::string& id, std::string_view type, std::string cdr) {
    Asset& asset = *call.add_assets();
    asset.set_id(id);
    asset.set_msg_type(std::string(type));
    asset.set_msg_data(std::move(cdr));
  }
  std::vector<std::string> words(const DroneReport& drone) {
    std::vector<std::string> all;
    for (const Event& event : drone.events.all()) all.push_back(event.what + " by " + event.who);
    return all;
  }

  SignedLedger ledger;
  std::unique_ptr<ChainAudit> audit;
};

TEST_F(ReportTest, WhoHeldADroneFromWhereToWhere) {
  const std::string acquired = ledger.acquire();
  const std::string released = ledger.submit(ledger.pilot, "release", SignedLedger::drones_call());
  ledger.acquire();
  const DroneReport& drone = reported();
  ASSERT_EQ(drone.holders.all().size(), 2U);
  const Tenure& first = drone.holders.all()[0];
  EXPECT_EQ(first.who, pilot_name);
  EXPECT_EQ(first.from.tx_id, acquired);
  ASSERT_TRUE(first.to);
  EXPECT_EQ(first.to->tx_id, released);
  EXPECT_EQ(first.ended_by, "release by " + pilot_name);
  EXPECT_FALSE(drone.holders.all()[1].to);
  EXPECT_GT(drone.holders.all()[1].epoch, first.epoch);
}

TEST_F(ReportTest, CommandsAreCountedByWhomAndByWhatBecameOfThem) {
  ledger.acquire();
  ledger.submit(ledger.pilot, "command", ledger.command_call(1, 1, 100, TAKEOFF));
  ledger.submit(ledger.pilot, "command", ledger.command_call(2, 1, 200));
  ledger.send(ledger.pilot, "release", SignedLedger::drones_call());
  ledger.send(ledger.pilot, "command", ledger.command_call(3, 1, 300));  // the release wrote what it read
  ledger.commit();
  const DroneReport& drone = reported();
  const Commands& commands = drone.commands.at(pilot_name);
  EXPECT_EQ(commands.valid, 2U);
  EXPECT_EQ(commands.invalid, (std::map<int, std::uint64_t>{{protos::MVCC_READ_CONFLICT, 1}}));
  EXPECT_THAT(words(drone), Contains("take-off by " + pilot_name));
  std::uint64_t valid = 0, invalid = 0;
  for (const auto& [at, both] : drone.commands_over_time.counts()) valid += both.first, invalid += both.second;
  EXPECT_EQ(valid, 2U);
  EXPECT_EQ(invalid, 1U);
}

TEST_F(ReportTest, ACommandInAHoldersPlaceNamesBoth) {
  LeaseCall call;
  call.add_drones("tello1");
  call.mutable_delegate()->set_msp_id("Org2MSP");
  call.mutable_delegate()->set_subject(ledger.admin2.name.subject);
  ledger.submit(ledger.pilot, "acquire", call.SerializeAsString());
  ledger.submit(ledger.admin2, "command", ledger.command_call(1, 1, 100, TAKEOFF));
  ledger.send(ledger.pilot, "release", SignedLedger::drones_call());
  ledger.send(ledger.admin2, "command", ledger.command_call(2, 1, 200));
  ledger.commit();
  const DroneReport& drone = reported();
  const std::string station = "Org2MSP/admin.Org2MSP", both = station + " under " + pilot_name + "'s lease";
  ASSERT_EQ(drone.holders.all().size(), 1U);
  EXPECT_EQ(drone.holders.all()[0].who, pilot_name);
  EXPECT_EQ(drone.holders.all()[0].delegate, station);
  EXPECT_EQ(drone.commands.at(both).valid, 1U);
  EXPECT_THAT(words(drone), Contains("take-off by " + both));
  EXPECT_EQ(drone.commands.at(station).valid, 0U) << "behind the release it is nobody's";
  EXPECT_THAT(to_table(*audit, {}), HasSubstr("held by " + pilot_name + ", commanded by " + station));
  EXPECT_EQ(to_json(*audit, {})["drones"]["tello1"]["holders"][0]["delegate"], station);
}

TEST_F(ReportTest, StopsClearsAndRolesAreReported) {
  ledger.submit(ledger.pilot, "stop", SignedLedger::drones_call());
  ledger.submit(ledger.pilot, "clear_stop", SignedLedger::drones_call());
  const DroneReport& drone = reported();
  EXPECT_THAT(words(drone), ::testing::ElementsAre("enroll by " + admin_name, "grant by " + admin_name,
                                                   "stop by " + pilot_name, "clear_stop by " + pilot_name));
  ASSERT_EQ(audit->report().roles().all().size(), 1U);
  EXPECT_EQ(audit->report().roles().all()[0].what, "OPERATOR " + pilot_name);
}

TEST_F(ReportTest, AnEnrolmentAndAGrantNameWhomTheyAreAbout) {
  reported();
  const std::string table = to_table(*audit, {"teleop", "memory", "anchor", {"tello1"}});
  EXPECT_THAT(table, HasSubstr("enroll on host Org1MSP/client.Org1MSP by " + admin_name));
  EXPECT_THAT(table, HasSubstr("grant to Org2MSP: fly up to priority"));
  EXPECT_THAT(to_json(*audit, {})["drones"]["tello1"]["words"][1]["object"].get<std::string>(),
              ::testing::StartsWith("to Org2MSP: fly"));
}

TEST_F(ReportTest, StopsAndClearsAreAllInTheTableWithTheirTransactions) {
  std::vector<std::string> transactions;
  for (int i = 0; i < 5; ++i) {
    transactions.push_back(ledger.submit(ledger.pilot, "stop", SignedLedger::drones_call()));
    transactions.push_back(ledger.submit(ledger.pilot, "clear_stop", SignedLedger::drones_call()));
  }
  reported();
  const std::string table = to_table(*audit, {});
  for (const std::string& id : transactions) EXPECT_THAT(table, HasSubstr(", transaction " + id + "\n"));
  EXPECT_THAT(table, HasSubstr("and 1 more: --json or --html has all\n")) << "enrolment";
}

TEST_F(ReportTest, TakeOffsAndLandingsAreAllInTheTable) {
  ledger.acquire();
  for (int i = 0; i < 10; ++i)
    ledger.submit(ledger.pilot, "command", ledger.command_call(i + 1, 1, 100 * (i + 1), i % 2 == 0 ? TAKEOFF : LAND));
  reported();
  const std::string table = to_table(*audit, {});
  int flown = 0;
  for (const Event& event : audit->report().drones().at("tello1").events.all()) {
    if (event.what != "take-off" && event.what != "landing") continue;
    ++flown;
    EXPECT_THAT(table, HasSubstr(fmt::format("{} by {}, block {},", event.what, pilot_name, event.when.block)));
  }
  EXPECT_EQ(flown, 10);
  EXPECT_THAT(table, HasSubstr("    grant to Org2MSP: "));
}

TEST_F(ReportTest, AnEnrolledDroneThatNeverFlewIsReportedAsThat) {
  reported();
  EXPECT_THAT(to_table(*audit, {}), HasSubstr("\n  1 enrolled drones never flew\n"));
  EXPECT_THAT(to_table(*audit, {"teleop", "memory", "anchor", {"tello1"}}), HasSubstr("enrolled, but never flew\n"));
  ledger.acquire();
  ledger.submit(ledger.pilot, "command", ledger.command_call(1, 1, 100, TAKEOFF));
  reported();
  EXPECT_THAT(to_table(*audit, {}), ::testing::Not(HasSubstr("never flew")));
}

TEST_F(ReportTest, TwoWayLatencyIsOfOneClock) {
  ledger.acquire();
  ledger.submit(ledger.pilot, "command", ledger.command_call(1, 1, 1'000 * ns_per_ms));
  StateSample sample;
  sample.boot_id = 7;
  sample.stamp_ns = 1'100 * ns_per_ms;
  sample.arrived_sequence = 1;
  sample.arrived_ns = 1'030 * ns_per_ms;
  for (int i = 0; i < 2; ++i) {  // the second one names the same command
    SetCall call;
    add(call, "tello1/link", link_status_type, link_status_to_cdr(sample, 0));
    ledger.submit(ledger.host, "set", call.SerializeAsString());
  }
  const DroneReport& drone = reported();
  EXPECT_EQ(drone.states, 2U);
  EXPECT_EQ(drone.two_way.count(), 1U);
  EXPECT_NEAR(to_ms(drone.two_way.quantile(0.5)), 30, 1);
}

TEST_F(ReportTest, TheFlownPathIsThinnedAndTheFailsafesTransitionsAreKept) {
  SetCall call;
  Odometry odometry;
  odometry.header = {ledger.now.real_ns, "map"};
  odometry.position_m = {1, 2, 3};
  add(call, "tello1/odom", odometry_type, to_cdr(odometry));
  Transition transition;
  transition.boot_id = 7;
  transition.number = 3;
  transition.phase = LinkPhase::flying;
  transition.mode = FailsafeMode::hold;
  transition.cause = FailsafeCause::ledger_silent;
  transition.stamp_ns = 5;
  add(call, "tello1/failsafe", transitions_type, transitions_to_cdr(odometry.header, "tello1", {transition}));
  add(call, "tello1/alarm", alarms_type,
      alarms_to_cdr(odometry.header, "tello1", {{"stream_contradicted", true, 2, "block 7: a fork", 7}}));
  ledger.submit(ledger.host, "set", call.SerializeAsString());
  ledger.submit(ledger.host, "set", call.SerializeAsString());
  SetCall over;
  over.set_stream(call.stream());
  add(over, "tello1/alarm", alarms_type,
      alarms_to_cdr(odometry.header, "tello1", {{"stream_contradicted", false, 2, "block 7: a fork", 7}}));
  ledger.submit(ledger.host, "set", over.SerializeAsString());
  const DroneReport& drone = reported();
  std::vector<std::string> alarms;
  for (const Event& event : drone.events.all()) {
    if (event.what.starts_with("alarm")) alarms.push_back(event.what);
  }
  EXPECT_EQ(alarms, (std::vector<std::string>{"alarm, stream_contradicted, 2 so far: block 7: a fork",
                                              "alarm, stream_contradicted: over"}));
  ASSERT_EQ(drone.transitions.all().size(), 1U) << "one that is said again is one";
  EXPECT_EQ(drone.transitions.all()[0].transition.cause, FailsafeCause::ledger_silent);
  EXPECT_EQ(drone.transitions_missing, 2U);
  ASSERT_EQ(drone.path.all().size(), 2U);
  EXPECT_EQ(drone.path.all()[0].position_m, (std::array<double, 3>{1, 2, 3}));
  const auto document = to_json(*audit, {"teleop", "memory", "anchor"});
  EXPECT_EQ(document["drones"]["tello1"]["failsafe"][0]["mode"], "hold");
  const std::string page = to_page(document);
  EXPECT_THAT(page, HasSubstr("ledger_silent"));
  EXPECT_THAT(page, ::testing::Not(HasSubstr("@DATA@")));
  EXPECT_THAT(page, ::testing::Not(HasSubstr("src=\"http")));
}

/// What endorsers let pass though it is not what the creator asked for, or may do.
class LiesTest : public ::testing::Test {
 protected:
  Control record(const std::string& holder, std::uint64_t epoch) const {
    Control control;
    control.set_drone("tello1");
    control.mutable_owner()->set_msp_id("Org1MSP");
    control.mutable_owner()->set_subject("CN=host");
    control.set_epoch(epoch);
    if (!holder.empty()) {
      control.mutable_holder()->set_msp_id("Org1MSP");
      control.mutable_holder()->set_subject(holder);
    }
    return control;
  }
  Status take(const std::string& function, const std::string& creator, const Control& after) {
    Controls event;
    *event.add_controls() = after;
    fabric::Transaction tx;
    tx.tx_id = std::to_string(++transactions);
    tx.contract = "ledgerline";
    tx.function = tx.event_name = function;
    tx.args = {"tello1"};
    tx.event_payload = event.SerializeAsString();
    if (function == "enroll") {
      EnrollCall call;
      call.add_drones("tello1");
      call.mutable_identity()->set_msp_id("Org1MSP");
      call.mutable_identity()->set_subject("CN=host");
      tx.args = {call.SerializeAsString()};
    }
    return report.add({transactions, 0, protos::VALID, ""}, tx, {{"Org1MSP", creator}, creator == "CN=admin"});
  }
  ChainReport report;
  std::uint64_t transactions = 0;
};

TEST_F(LiesTest, ALeaseForSomebodyWhoDidNotAskForItIsFoundAndNotReported) {
  ASSERT_TRUE(take("enroll", "CN=admin", record("", 0)));
  ASSERT_TRUE(take("acquire", "CN=pilot", record("CN=pilot", 1)));
  const Status status = take("release", "CN=other", record("", 2));
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message,
              HasSubstr("release of tello1 does not follow: holder: Org1MSP CN=other does not hold the lease"));
  EXPECT_FALSE(take("acquire", "CN=other", record("CN=third", 2)));
  ASSERT_EQ(report.drones().at("tello1").holders.all().size(), 1U);
  EXPECT_FALSE(report.drones().at("tello1").holders.all()[0].to);
}

TEST_F(LiesTest, AStampThatNoStateCanHaveIsNoLatency) {
  ASSERT_TRUE(take("enroll", "CN=admin", record("", 0)));
  fabric::Transaction tx;
  tx.contract = "ledgerline";
  const access::Caller who{{"Org1MSP", "CN=pilot"}, false};
  CommandCall command;
  DronePlan& plan = *command.add_plans();
  plan.set_drone("tello1");
  plan.set_boot_id(7);
  plan.set_sequence(1);
  plan.set_state_stamp_ns(INT64_MIN);
  tx.function = tx.event_name = "command";
  tx.args = {command.SerializeAsString()};
  ASSERT_TRUE(report.add({2, 0, protos::VALID, ""}, tx, who));
  StateSample sample;
  sample.boot_id = 7;
  sample.arrived_sequence = 1;
  sample.arrived_ns = ns_per_s;
  SetCall state;
  state.add_assets()->set_id("tello1/link");
  state.mutable_assets(0)->set_msg_type(std::string(link_status_type));
  state.mutable_assets(0)->set_msg_data(link_status_to_cdr(sample, 0));
  tx.function = tx.event_name = "set";
  tx.args = {state.SerializeAsString()};
  tx.event_payload = tx.args[0];
  ASSERT_TRUE(report.add({3, 0, protos::VALID, ""}, tx, who));
  EXPECT_EQ(report.drones().at("tello1").states, 1U);
  EXPECT_EQ(report.drones().at("tello1").two_way.count(), 0U);
}

TEST_F(LiesTest, TransactionsOfOtherContractsTellNothingOfDrones) {
  fabric::Transaction tx;
  tx.tx_id = "a";
  tx.contract = "other";
  tx.function = tx.event_name = "acquire";
  EXPECT_TRUE(report.add({1, 0, protos::VALID, ""}, tx, {{"Org1MSP", "CN=pilot"}, false}));
  EXPECT_EQ(report.functions().at("other:"), 1U);
  EXPECT_TRUE(report.drones().empty());
}

TEST(BoundedTest, AThinnedListStaysBetweenHalfAndAllOfItsBound) {
  Thinned<int> list(100);
  for (int i = 0; i < 10'000; ++i) list.add(i);
  EXPECT_GE(list.all().size(), 50U);
  EXPECT_LT(list.all().size(), 100U);
  for (std::size_t i = 0; i < list.all().size(); ++i)
    EXPECT_EQ(list.all()[i], static_cast<int>(i * list.step())) << "evenly over the whole";
  EXPECT_EQ(list.count(), 10'000U);
}

TEST(BoundedTest, CountsOverTimeStayFewAndLoseNothing) {
  OverTime counted;
  for (int i = 0; i < 5'000; ++i) counted.add((1'700'000'000 + i) * ns_per_s, i % 2 == 0);
  EXPECT_LE(counted.counts().size(), 600U);
  std::uint64_t all = 0;
  for (const auto& [at, both] : counted.counts()) all += both.first + both.second;
  EXPECT_EQ(all, 5'000U);
}

}  // namespace
}  // namespace ledgerline::audit
