#include "ground/core/lease/lease_book.hpp"

#include <gtest/gtest.h>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

TEST(LeaseBook, MayCommandUnderItsOwnLeaseWhileNobodyStops) {
  const FlightConfig config = config_for(2);
  FlightTransactions counters;
  LeaseBook leases(config, counters);
  EXPECT_FALSE(leases.of(0).may_command);
  const auto change = leases.set(control_record("tello1", operator_name));
  ASSERT_TRUE(change.ok());
  ASSERT_TRUE(change->has_value());
  EXPECT_TRUE((*change)->new_epoch);
  EXPECT_TRUE(leases.of(0).may_command);
  EXPECT_FALSE(leases.of(1).may_command);
  Stops stops;
  *stops.add_stops() = stop_of("tello1", outsider_name);
  EXPECT_EQ(leases.on_event(control_event("stop", {"tello1"}, stops.SerializeAsString()), 0).size(), 1u);
  EXPECT_FALSE(leases.of(0).may_command);
}

TEST(LeaseBook, MayCommandForAHolderWhoLetsItAndNotWhereAnotherCommandsForUs) {
  const FlightConfig config = config_for(1);
  FlightTransactions counters;
  LeaseBook leases(config, counters);
  ASSERT_TRUE(leases.set(delegated_record("tello1", "CN=pilot")).ok());
  EXPECT_TRUE(leases.of(0).may_command);
  EXPECT_EQ(leases.of(0).commander, operator_name);
  EXPECT_EQ(holder_words(leases.of(0)), "CN=pilot, who lets CN=User1@org2 command it");
  Control lent = control_record("tello1", operator_name, 2);
  lent.mutable_delegate()->set_msp_id(operator_name.msp_id);
  lent.mutable_delegate()->set_subject("CN=station");
  ASSERT_TRUE(leases.set(lent).ok());
  EXPECT_FALSE(leases.of(0).may_command);
  ASSERT_TRUE(leases.set(control_record("tello1", operator_name, 3)).ok());
  EXPECT_TRUE(leases.of(0).may_command);
  EXPECT_EQ(leases.of(0).commander, operator_name);
}

TEST(LeaseBook, WithHolderOrDelegateRevokedNobodyCommands) {
  const FlightConfig config = config_for(1);
  for (const std::string& who : {std::string("CN=pilot"), operator_name.subject}) {
    FlightTransactions counters;
    LeaseBook leases(config, counters);
    ASSERT_TRUE(leases.set(delegated_record("tello1", "CN=pilot")).ok());
    Controls reported;
    reported.mutable_identity()->set_msp_id(operator_name.msp_id);
    reported.mutable_identity()->set_subject(who);
    reported.set_role(REVOKED);
    RevokeCall call;
    *call.mutable_identity() = reported.identity();
    const auto revoke = control_event("revoke", {call.SerializeAsString()}, reported.SerializeAsString());
    EXPECT_EQ(leases.on_event(revoke, 0).size(), 1u) << who;
    EXPECT_TRUE(leases.of(0).revoked);
    EXPECT_FALSE(leases.of(0).may_command);
  }
}

TEST(LeaseBook, AnOlderRecordAndADroneThatDoesNotFlyHereChangeNothing) {
  const FlightConfig config = config_for(1);
  FlightTransactions counters;
  LeaseBook leases(config, counters);
  ASSERT_TRUE(leases.set(control_record("tello1", operator_name, 3)).ok());
  EXPECT_FALSE(leases.set(control_record("tello1", outsider_name, 2))->has_value());
  EXPECT_TRUE(leases.of(0).may_command);
  EXPECT_FALSE(leases.set(control_record("tello9", operator_name)).ok());
}

TEST(LeaseBook, WithoutALedgerAllAreOurs) {
  FlightConfig config = config_for(1);
  config.ledger = false;
  FlightTransactions counters;
  EXPECT_TRUE(LeaseBook(config, counters).of(0).may_command);
}

}  // namespace
}  // namespace ledgerline::ground
