#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "sim/core/parameters.hpp"
#include "tests/unit/sim/flight.hpp"

namespace ledgerline::sim {
namespace {

TEST(Latency, ACommandTakesEffectSoMuchLater) {
  Parameters p = Flight::calm();
  p.sdk.command_latency_s = 0.06;
  Flight flight(p);
  const TimeNs asked = flight.now;
  EXPECT_EQ(flight.ask("command", 1), "ok");
  EXPECT_NEAR(to_seconds(flight.now - asked), 0.06, 0.002);
  flight.ask("takeoff", 20);
  flight.run(1);
  flight.tell("rc 0 100 0 0");
  flight.run(0.055);
  EXPECT_LT(flight.truth().tilt_rad, 0.005) << "not yet";
  flight.run(0.1);
  EXPECT_GT(flight.truth().tilt_rad, 0.05);
}

TEST(Latency, AStateTextIsOfSoMuchBefore) {
  Parameters p = Flight::calm();
  p.sdk.state_latency_s = 0.08;
  Flight late(p), at_once;
  for (Flight* flight : {&late, &at_once}) {
    flight->take_off();
    flight->run(0.5);
    flight->states.clear();
    flight->tell("rc 0 0 80 0");
    flight->run(2);
  }
  ASSERT_GE(late.states.size(), 18U);
  ASSERT_EQ(at_once.states.size(), late.states.size());
  // The same texts, each 80 ms later than it was true: of those since `clear` the first one was inside the drone.
  int same = 0;
  for (std::size_t i = 1; i < late.states.size(); ++i) same += late.states[i].bytes == at_once.states[i - 1].bytes;
  EXPECT_GE(same, 15);
}

TEST(Latency, WhatIsInsideIsLostWhenItIsSwitchedOff) {
  Parameters p = Flight::calm();
  p.sdk.command_latency_s = 0.1;
  Flight flight(p);
  ASSERT_EQ(flight.ask("command", 1), "ok");
  flight.answers.clear();
  flight.tell("command");
  flight.simulator.restart(1);
  flight.run(1);
  EXPECT_TRUE(flight.answers.empty());
}

Parameters hot() {
  Parameters p = Flight::calm();
  p.heat = {.start_c = 70, .ground_c = 105, .idling_c = 65, .flight_c = 85.5, .time_s = 200, .shutdown_c = 95};
  return p;
}

TEST(Heat, OnTheGroundItWarmsUntilItSwitchesItselfOff) {
  Flight flight(hot());
  ASSERT_EQ(flight.ask("command", 1), "ok");
  flight.run(60);
  EXPECT_GT(flight.reported("templ"), 75);
  EXPECT_LT(flight.reported("templ"), 95);
  flight.run(240);
  flight.states.clear();
  EXPECT_EQ(flight.ask("command", 2), "") << "off";
  EXPECT_TRUE(flight.states.empty());
  flight.simulator.set_temperature(1, 60);
  flight.simulator.restart(1);
  EXPECT_EQ(flight.ask("command", 2), "ok") << "cooled down, and switched on again";
}

TEST(Heat, FlyingAndIdlingCool) {
  Flight idling(hot()), flying(hot());
  idling.ask("command", 1);
  EXPECT_EQ(idling.ask("motoron", 1), "ok");
  idling.run(100);
  EXPECT_LT(idling.reported("templ"), 70);
  flying.take_off();
  flying.run(5);
  flying.simulator.set_temperature(1, 94);
  flying.run(10);
  EXPECT_LT(flying.reported("templ"), 94);
  EXPECT_TRUE(flying.truth().in_flight);
}

TEST(Heat, TooHotInFlightItLandsAndRefusesMovesMeanwhile) {
  Flight flight;
  flight.take_off();
  flight.tell("forward 500");
  flight.run(0.5);
  flight.answers.clear();
  flight.simulator.set_temperature(1, 110);
  flight.run(0.1);
  ASSERT_EQ(flight.answers.size(), 1U);
  EXPECT_EQ(flight.answers[0].bytes, "error Auto land") << "what it breaks off";
  EXPECT_EQ(flight.ask("up 50", 1), "error Auto land");
  EXPECT_EQ(flight.ask("takeoff", 1), "error Auto land");
  flight.run(10);
  EXPECT_FALSE(flight.truth().motors_on);
  EXPECT_EQ(flight.ask("battery?", 1), "") << "and is off";
}

TEST(Errors, ATakeOffWithoutAValidImuIsRefused) {
  Parameters p = Flight::calm();
  p.control.imu_ready_s = 2;
  Flight flight(p);
  ASSERT_EQ(flight.ask("command", 1), "ok");
  EXPECT_EQ(flight.ask("takeoff", 1), "error No valid imu");
  flight.run(2);
  EXPECT_EQ(flight.ask("takeoff", 20), "ok");
  EXPECT_EQ(flight.ask("land", 20), "ok");
  Sensing broken;
  broken.imu = false;
  flight.simulator.set_sensing(1, broken);
  EXPECT_EQ(flight.ask("takeoff", 1), "error No valid imu");
}

TEST(Battery, SagsUnderItsLoadAndComesBack) {
  Parameters p = Flight::calm();
  p.battery.load_sag = 0.05;
  p.battery.start = 0.5;
  Flight flight(p);
  ASSERT_EQ(flight.ask("command", 1), "ok");
  flight.run(2);
  EXPECT_EQ(flight.reported("bat"), 50);
  flight.ask("takeoff", 20);
  flight.run(3);
  EXPECT_NEAR(flight.reported("bat"), 44, 1);
  EXPECT_NEAR(flight.truth().battery, 0.49, 0.01) << "what is left in truth";
  flight.ask("land", 20);
  flight.run(3);
  EXPECT_NEAR(flight.reported("bat"), 49, 1);
}

// Every parameter that is drawn, in one row.
std::vector<double> row(const Parameters& p) {
  return {p.control.velocity_lag_s,
          p.sdk.rc_full_mps,
          p.control.max_acceleration_mps2,
          p.body.drag_xy_per_s,
          p.control.hold_after_s,
          p.control.hold_integral_per_s2,
          p.control.attitude_after_s,
          p.control.attitude_full_rad,
          p.control.takeoff_drift_m,
          p.control.imu_ready_s,
          p.sdk.command_latency_s,
          p.sdk.state_latency_s,
          p.air.jet_mps,
          p.air.thrust_lost_per_mps,
          p.air.turbulence,
          p.air.ground_effect_radius_m,
          p.battery.load_sag,
          p.heat.start_c,
          p.heat.ground_c,
          p.heat.time_s,
          p.heat.shutdown_c};
}

TEST(DrawnTello, EachSeedIsAnotherDroneAndAlwaysTheSame) {
  EXPECT_EQ(row(draw_tello({}, 7)), row(draw_tello({}, 7)));
  const auto one = row(draw_tello({}, 7)), other = row(draw_tello({}, 8));
  for (std::size_t i = 0; i < one.size(); ++i) EXPECT_NE(one[i], other[i]) << i;
}

TEST(DrawnTello, CoversItsRanges) {
  double least = 1, most = 0;
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    const Parameters p = draw_tello({}, seed);
    EXPECT_GE(p.sdk.command_latency_s, TelloRanges{}.command_latency_s.least);
    EXPECT_LE(p.sdk.command_latency_s, TelloRanges{}.command_latency_s.most);
    EXPECT_GT(p.heat.shutdown_c, p.heat.flight_c) << "it may fly for as long as its battery lasts";
    least = std::min(least, p.sdk.command_latency_s);
    most = std::max(most, p.sdk.command_latency_s);
  }
  EXPECT_LT(least, 0.012);
  EXPECT_GT(most, 0.078);
}

TEST(DrawnTello, EachFliesHoldsAndLands) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    Parameters p = draw_tello(Flight::calm(), seed);
    p.seed = seed;
    Flight flight(p);
    flight.ask("command", 1);
    flight.run(1);
    EXPECT_EQ(flight.ask("takeoff", 20), "ok") << seed;
    flight.tell("rc 0 50 0 0");
    flight.run(3);
    flight.tell("rc 0 0 0 0");
    flight.run(5);
    EXPECT_LT(std::hypot(flight.truth().velocity_mps[0], flight.truth().velocity_mps[1]), 0.08) << seed;
    EXPECT_EQ(flight.ask("land", 30), "ok") << seed;
  }
}

}  // namespace
}  // namespace ledgerline::sim
