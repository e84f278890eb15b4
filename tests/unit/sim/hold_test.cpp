#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "tests/unit/sim/flight.hpp"

namespace ledgerline::sim {
namespace {

double ground_speed(const Truth& truth) { return std::hypot(truth.velocity_mps[0], truth.velocity_mps[1]); }

double off(const Truth& truth, double x_m, double y_m) {
  return std::hypot(truth.position_m[0] - x_m, truth.position_m[1] - y_m);
}

TEST(VisionHold, StandsStillInWindThatItIsCentredIn) {
  for (const double wind_mps : {1.0, 2.0, 4.0}) {
    Flight flight;
    flight.take_off();
    flight.simulator.set_wind({wind_mps, 0, 0});
    flight.run(9);
    const Truth before = flight.truth();
    flight.run(4);
    EXPECT_LT(off(flight.truth(), before.position_m[0], before.position_m[1]), 0.05) << wind_mps;
    EXPECT_LT(off(flight.truth(), 0, 0), 0.05) << "back where it was when the wind came: " << wind_mps;
    ASSERT_EQ(flight.ask("land"), "ok");
    EXPECT_LT(off(flight.truth(), 0, 0), 0.1) << "it lands with what it has learned: " << wind_mps;
  }
}

TEST(VisionHold, TakesAPositionThoughTheWindNeverLetsItRest) {
  Flight flight;
  flight.take_off();
  flight.simulator.set_wind({3, 0, 0});
  flight.tell("rc 0 50 0 0");
  flight.run(3);
  flight.tell("rc 0 0 0 0");
  const double released_m = flight.truth().position_m[0];
  flight.run(12);
  EXPECT_LT(ground_speed(flight.truth()), 0.05);
  EXPECT_LT(flight.truth().position_m[0], released_m + 1.2);
}

TEST(VisionHold, AKickIsFlownBack) {
  Flight flight;
  flight.take_off();
  flight.run(2);
  flight.simulator.kick(1, {1, 0, 0});
  flight.run(8);
  EXPECT_LT(off(flight.truth(), 0, 0), 0.1);
}

TEST(VisionHold, WhatALongClimbWouldTeachItIsForgottenAtTheTop) {
  Flight flight;
  flight.take_off();
  double highest_m = 0;
  for (int i = 0; i < 50; ++i) {
    flight.run(0.1);
    highest_m = std::max(highest_m, flight.truth().position_m[2]);
  }
  EXPECT_NEAR(flight.truth().position_m[2], 1, 0.03);
  EXPECT_LT(highest_m, 1.1);
}

Sensing dark() {
  Sensing sensing;
  sensing.light = 0;
  return sensing;
}

TEST(AttitudeMode, CentredSticksDoNotBrakeAndTheAirAloneSlows) {
  Flight flight;
  flight.take_off();
  flight.simulator.set_sensing(1, dark());
  flight.run(1);
  flight.simulator.kick(1, {2, 0, 0});
  flight.run(2);
  const double rate = flight.simulator.truth(1).velocity_mps[0] / 2;
  EXPECT_NEAR(rate, std::exp(-2 * BodyParameters{}.drag_xy_per_s), 0.03);
  EXPECT_LT(flight.truth().tilt_rad, 0.03) << "it feels no speed, and leans against none";
  EXPECT_EQ(flight.reported("vgx"), 0);
  EXPECT_NEAR(flight.truth().position_m[2], 1, 0.05) << "its height it still has";
}

TEST(AttitudeMode, ASteadyStickIsASteadyLeanAndASpeedThatGrows) {
  Flight flight;
  flight.take_off();
  flight.simulator.set_sensing(1, dark());
  flight.run(1);
  flight.tell("rc 0 50 0 0");
  flight.run(3);
  const double full = std::tan(ControlParameters{}.attitude_full_rad);
  EXPECT_NEAR(std::tan(flight.truth().tilt_rad), full / 2, 0.02);
  EXPECT_NEAR(flight.reported("pitch"), -9.4, 1) << "which is all that the state text shows of it";
  EXPECT_GT(ground_speed(flight.truth()), 2.5) << "five times what 50 means with flow";
  EXPECT_EQ(flight.reported("vgx"), 0);
}

TEST(AttitudeMode, WindCarriesItAwayAndLightBringsTheHoldBack) {
  Flight flight;
  flight.take_off();
  flight.simulator.set_sensing(1, dark());
  flight.simulator.set_wind({1, 0, 0});
  flight.run(8);
  EXPECT_GT(ground_speed(flight.truth()), 0.8);
  flight.simulator.set_sensing(1, {});
  flight.run(6);
  const Truth held = flight.truth();
  flight.run(5);
  EXPECT_LT(off(flight.truth(), held.position_m[0], held.position_m[1]), 0.1);
}

TEST(AttitudeMode, WhatItHeldAgainstTheWindIsGoneWithTheLight) {
  Flight flight;
  flight.take_off();
  flight.simulator.set_wind({2, 0, 0});
  flight.run(5);
  EXPECT_GT(flight.truth().tilt_rad, 0.06) << "it leans into the wind";
  flight.simulator.set_sensing(1, dark());
  flight.run(7);
  EXPECT_LT(flight.truth().tilt_rad, 0.03) << "nothing tells it any more to lean";
  EXPECT_GT(ground_speed(flight.truth()), 1.6);
}

TEST(AttitudeMode, HowFarItLeansIsTheDronesOwn) {
  Parameters p = Flight::calm();
  p.control.attitude_full_rad = 0.17;
  Flight flight(p);
  flight.take_off();
  flight.simulator.set_sensing(1, dark());
  flight.run(1);
  flight.tell("rc 0 50 0 0");
  flight.run(3);
  EXPECT_NEAR(std::tan(flight.truth().tilt_rad), std::tan(0.17) / 2, 0.01);
}

TEST(AttitudeMode, AMomentWithoutFlowIsNone) {
  Flight flight;
  flight.take_off();
  flight.tell("rc 0 50 0 0");
  flight.run(2);
  flight.simulator.set_sensing(1, dark());
  flight.run(0.2);
  flight.simulator.set_sensing(1, {});
  flight.run(1.5);
  EXPECT_NEAR(flight.truth().velocity_mps[0], 0.5, 0.05);
}

TEST(OwnHeight, ItClimbsOverATable) {
  Parameters p = Flight::calm();
  p.control.follows_floor = true;
  p.tables.push_back({.x_m = 2, .y_m = 0, .length_m = 1, .width_m = 2, .height_m = 0.5});
  Flight flight(p);
  flight.take_off();
  flight.tell("rc 0 50 0 0");
  double highest_m = 0;
  for (int i = 0; i < 80; ++i) {
    flight.run(0.1);
    highest_m = std::max(highest_m, flight.truth().position_m[2]);
  }
  EXPECT_GT(highest_m, 1.3) << "tof says that it sank";
  EXPECT_NEAR(flight.truth().position_m[2], 1, 0.15) << "behind it";
}

TEST(OwnHeight, WithoutTofItFollowsTheBarometer) {
  Flight flight;
  flight.take_off();
  Sensing sensing;
  sensing.baro_drift_mps = -0.1;
  flight.simulator.set_sensing(1, sensing);
  flight.run(5);
  EXPECT_NEAR(flight.truth().position_m[2], 1, 0.03) << "it sees the floor";
  sensing.tof = false;
  flight.simulator.set_sensing(1, sensing);
  flight.run(5);
  EXPECT_NEAR(flight.truth().position_m[2], 1.5, 0.1) << "the barometer says that it sinks, so it climbs";
}

TEST(TakeOff, ItGoesAwaySidewaysByWhatItIsSent) {
  std::set<int> directions;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    Parameters p = Flight::calm();
    p.control.takeoff_drift_m = 0.3;
    p.seed = seed;
    Flight flight(p);
    flight.take_off();
    flight.run(3);
    const Truth truth = flight.truth();
    EXPECT_NEAR(off(truth, 0, 0), 0.3, 0.1) << seed;
    EXPECT_LT(ground_speed(truth), 0.05);
    directions.insert(static_cast<int>(2 * std::atan2(truth.position_m[1], truth.position_m[0])));
  }
  EXPECT_GT(directions.size(), 2U);
}

}  // namespace
}  // namespace ledgerline::sim
