#include "ground/core/flight/state_intake.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

StateSample sample(std::uint64_t boot, std::uint64_t sequence) {
  StateSample state;
  state.boot_id = boot;
  state.sequence = sequence;
  return state;
}

struct IntakeWorld {
  explicit IntakeWorld(int drones) : config(config_for(drones)) {}

  const FlightConfig config;
  FlightTransactions counters;
  const LeaseBook leases{config, counters};
  StateIntake intake{config, leases, counters};
};

TEST(StateIntake, OfABatchEachNewerStateCountsAndWhatRidesAgainIsNoNews) {
  IntakeWorld w(2);
  w.intake.accept(1, sample(9, 5), ns_per_s);
  SetCall call;
  add_state(call, "tello1", sample(9, 1));
  add_state(call, "tello1", sample(9, 2));
  add_state(call, "tello2", sample(9, 5));
  add_state(call, "tello7", sample(9, 6));
  std::vector<DroneUpdate> updates;
  const auto states = w.intake.read(event("set", call.SerializeAsString()), 0, updates);
  ASSERT_EQ(states.size(), 2u);
  EXPECT_EQ(states[1].state.sequence, 2u);
  ASSERT_EQ(updates.size(), 1u);
  EXPECT_EQ(updates[0].drone, 0u);
}

TEST(StateIntake, AnotherBootIsNewAndASignOfLifeIsReported) {
  IntakeWorld w(1);
  w.intake.accept(0, sample(9, 5), ns_per_s);
  EXPECT_FALSE(w.intake.is_new(0, sample(9, 5)));
  EXPECT_TRUE(w.intake.is_new(0, sample(8, 1)));
  w.intake.accept(0, sample(8, 1), std::nullopt);
  EXPECT_EQ(w.intake.of(0).received_ns, ns_per_s) << "no sign of life";
  EXPECT_EQ(w.intake.of(0).state.boot_id, 8u);
}

TEST(StateIntake, AStatesPoseIsItsOdometrysAndItsChargeTheNewestBatterys) {
  IntakeWorld w(1);
  std::vector<DroneUpdate> updates;
  const auto take = [&](std::uint64_t sequence, TimeNs pose_stamp_ns, std::optional<float> charge) {
    SetCall call;
    call.set_stream(true);
    if (charge) {
      Asset& battery = *call.add_assets();
      battery.set_id("tello1/battery");
      battery.set_msg_type(std::string(battery_type));
      battery.set_msg_data(to_cdr(BatteryState{{0, "tello1/base_link"}, 0, *charge}));
    }
    StateSample state = sample(9, sequence);
    state.stamp_ns = ns_per_s;
    state.pose_stamp_ns = pose_stamp_ns;
    state.position_m = {1, 2, 3};
    state.battery = 0.125F;  // link's own number is not sent
    add_state(call, "tello1", state);
    fabric::Transaction tx = event("set", call.SerializeAsString());
    tx.event_payload.clear();
    const auto states = w.intake.read(tx, 0, updates);
    EXPECT_EQ(states.size(), 1u);
    w.intake.accept(0, states.at(0).state, std::nullopt);
    return states.at(0).state;
  };
  EXPECT_LT(take(1, 0, std::nullopt).battery, 0) << "who begins to read in the middle";
  EXPECT_EQ(take(2, 0, 0.75F).battery, 0.75F);
  const StateSample third = take(3, ns_per_s - 5, std::nullopt);
  EXPECT_EQ(third.battery, 0.75F);
  EXPECT_EQ(third.pose_stamp_ns, ns_per_s - 5);
  EXPECT_EQ(third.position_m, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(take(4, 0, std::numeric_limits<float>::quiet_NaN()).battery, 0.75F) << "unknown says nothing";
  EXPECT_EQ(updates.size(), 4u);
  EXPECT_TRUE(updates[2].battery.empty());
}

TEST(StateIntake, WhatIsNoBatchIsCounted) {
  IntakeWorld w(1);
  std::vector<DroneUpdate> updates;
  EXPECT_TRUE(w.intake.read(event("set", "\xff"), 0, updates).empty());
  EXPECT_EQ(w.counters.malformed, 1u);
}

}  // namespace
}  // namespace ledgerline::ground
