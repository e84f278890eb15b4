#include "onboard/agent/core/records.hpp"

#include <gmock/gmock.h>

#include "common/access/stops.hpp"
#include "onboard/agent/core/command_check.hpp"
#include "tests/unit/onboard/agent/core/ledger_of_tests.hpp"

namespace ledgerline::agent {
namespace {

using ::testing::HasSubstr;
using testing::LedgerOfTests;

constexpr TimeNs at_ns = 100 * ns_per_s;
constexpr std::int64_t at_s = 1'700'000'000;

FirstRecords some_records() {
  FirstRecords records;
  records.controls = {testing::control("tello1", 5), testing::control("tello2", 6)};
  records.roles.apply({to_message(LedgerOfTests::operator_name()), OPERATOR});
  return records;
}

TEST(FirstRecordsTest, ComeBackFromACheckpointAsTheyWere) {
  const auto read = records_from(to_bytes(some_records()), {"tello1", "tello2"});
  ASSERT_TRUE(read);
  ASSERT_EQ(read->controls.size(), 2U);
  EXPECT_EQ(read->controls[1].SerializeAsString(), testing::control("tello2", 6).SerializeAsString());
  EXPECT_EQ(read->roles.of(LedgerOfTests::operator_name()), OPERATOR);
  EXPECT_EQ(read->roles.all().size(), 1U);
}

TEST(FirstRecordsTest, SayWhoseRolesTheyHave) {
  FirstRecords records = some_records();
  records.roles.follow("Org4MSP");  // which has none
  records.roles.await("Org5MSP");
  records.roles.apply({to_message({"Org5MSP", "CN=far"}), OPERATOR});
  const auto read = records_from(to_bytes(records), {"tello1", "tello2"});
  ASSERT_TRUE(read);
  EXPECT_TRUE(read->roles.follows("Org4MSP"));
  EXPECT_FALSE(read->roles.follows("Org5MSP")) << "it is read again";
  EXPECT_EQ(read->roles.all().size(), 1U);
}

TEST(FirstRecordsTest, AreNotMadeLargeByOrganisationsThatDoNotMatter) {
  const std::unique_ptr<crypto::MspRegistry> registry = crypto::make_test_registry({"Org1MSP", "Org2MSP", "Org3MSP"});
  const std::vector<DroneName> drones{{1, "tello1"}};
  CommandCheck check(CommandCheckSettings{}, drones, *registry);
  check.control().set_roles(some_records().roles);
  check.control().set_control(some_records().controls[0]);
  const std::size_t before = to_bytes(check.control().records()).size();
  LedgerOfTests ledger;
  for (int i = 0; i < 200; ++i) {
    EnrollCall call;
    *call.mutable_identity() = to_message({"Org3MSP", "CN=s" + std::to_string(i)});
    call.set_role(AUDITOR);
    Controls reported;
    *reported.mutable_identity() = call.identity();
    reported.set_role(AUDITOR);
    LedgerOfTests::Tx enroll;
    enroll.creator = {"Org3MSP", "CN=Admin@org3.ledgerline"};
    enroll.event_name = "enroll";
    enroll.event_payload = reported.SerializeAsString();
    enroll.asked = fabric::Call{"enroll", {call.SerializeAsString()}};
    check.check(at_ns, at_s, ledger.block({enroll}));
  }
  EXPECT_EQ(check.control().refused_events(), 0U);
  EXPECT_EQ(to_bytes(check.control().records()).size(), before);
}

TEST(FirstRecordsTest, WithoutADronesRecordAreNotTheOnesToBeginWith) {
  const auto read = records_from(to_bytes(some_records()), {"tello1", "tello3"});
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().message, "it has no record of tello3");
  EXPECT_THAT(records_from("none", {"tello1"}).error().message, HasSubstr("cannot be read"));
}

// What a checkpoint holds must be what the blocks have made of the records, or the blocks behind it do not follow.
TEST(FirstRecordsTest, OfACheckAreThoseThatItsBlocksHaveMade) {
  const std::unique_ptr<crypto::MspRegistry> registry = crypto::make_test_registry({"Org1MSP", "Org2MSP"});
  const std::vector<DroneName> drones{{1, "tello1"}};
  CommandCheck check(CommandCheckSettings{}, drones, *registry);
  FirstRecords first = some_records();
  check.control().set_roles(first.roles);
  check.control().set_control(first.controls[0]);
  LedgerOfTests ledger;
  Stops stops;
  *stops.add_stops() = testing::stop_of("tello1");
  LedgerOfTests::Tx stop;
  stop.event_name = "stop";
  stop.event_payload = stops.SerializeAsString();
  const fabric::Block block = ledger.block({stop});
  ASSERT_EQ(check.check(at_ns, at_s, block).plans.size(), 1U);
  const auto kept = records_from(to_bytes(check.control().records()), {"tello1"});
  ASSERT_TRUE(kept);
  EXPECT_TRUE(is_stopped(kept->controls[0]));
  EXPECT_EQ(kept->roles.of(LedgerOfTests::operator_name()), OPERATOR);
  EXPECT_EQ(check.height(), block.number + 1);

  // Another agent that begins there takes what comes behind it.
  CommandCheck next(CommandCheckSettings{}, drones, *registry);
  next.control().set_roles(kept->roles);
  next.control().set_control(kept->controls[0]);
  EXPECT_TRUE(next.standing_stop(at_ns, 1));
}

}  // namespace
}  // namespace ledgerline::agent
