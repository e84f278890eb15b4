#include "ground/core/flight/state_intake.hpp"

#include <gtest/gtest.h>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

StateSample sample(std::uint64_t boot, std::uint64_t sequence) {
  StateSample state;
  state.boot_id = boot;
  state.sequence = sequence;
  return state;
}

TEST(StateIntake, OfAFrameEachNewerStateCountsAndWhatRidesAgainIsNoNews) {
  const FlightConfig config = config_for(2);
  FlightTransactions counters;
  const LeaseBook leases(config, counters);
  StateIntake intake(config, leases, counters);
  intake.accept(1, sample(9, 5), ns_per_s);
  SetCall call;
  *call.add_assets() = status_asset("tello1", sample(9, 1));
  *call.add_assets() = status_asset("tello1", sample(9, 2));
  *call.add_assets() = status_asset("tello2", sample(9, 5));
  *call.add_assets() = status_asset("tello7", sample(9, 6));
  std::vector<DroneUpdate> news;
  const auto states = intake.take(event("set", call.SerializeAsString()), 0, news);
  ASSERT_EQ(states.size(), 2u);
  EXPECT_EQ(states[1].state.sequence, 2u);
  ASSERT_EQ(news.size(), 1u);
  EXPECT_EQ(news[0].drone, 0u);
}

TEST(StateIntake, AnotherBootIsNewAndASignOfLifeIsReported) {
  const FlightConfig config = config_for(1);
  FlightTransactions counters;
  const LeaseBook leases(config, counters);
  StateIntake intake(config, leases, counters);
  intake.accept(0, sample(9, 5), ns_per_s);
  EXPECT_FALSE(intake.is_new(0, sample(9, 5)));
  EXPECT_TRUE(intake.is_new(0, sample(8, 1)));
  intake.accept(0, sample(8, 1), std::nullopt);
  EXPECT_EQ(intake.of(0).received_ns, ns_per_s) << "no sign of life";
  EXPECT_EQ(intake.of(0).state.boot_id, 8u);
}

TEST(StateIntake, WhatIsNoFrameIsCounted) {
  const FlightConfig config = config_for(1);
  FlightTransactions counters;
  const LeaseBook leases(config, counters);
  StateIntake intake(config, leases, counters);
  std::vector<DroneUpdate> news;
  EXPECT_TRUE(intake.take(event("set", "\xff"), 0, news).empty());
  EXPECT_EQ(counters.malformed, 1u);
}

}  // namespace
}  // namespace ledgerline::ground
