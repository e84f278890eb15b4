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
  *stops.add_stops() = stop_of("tello1", stranger_name);
  EXPECT_EQ(leases.take(control_event("stop", {"tello1"}, stops.SerializeAsString()), 0).size(), 1u);
  EXPECT_FALSE(leases.of(0).may_command);
}

TEST(LeaseBook, AnOlderRecordAndADroneThatDoesNotFlyHereChangeNothing) {
  const FlightConfig config = config_for(1);
  FlightTransactions counters;
  LeaseBook leases(config, counters);
  ASSERT_TRUE(leases.set(control_record("tello1", operator_name, 3)).ok());
  EXPECT_FALSE(leases.set(control_record("tello1", stranger_name, 2))->has_value());
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
