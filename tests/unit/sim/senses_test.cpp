#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/core/firmware/odometry.hpp"
#include "sim/core/sensors.hpp"
#include "tests/unit/sim/flight.hpp"

namespace ledgerline::sim {
namespace {

double deviation(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value * value;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

// What the integral of an Ornstein-Uhlenbeck process has as its standard deviation after t.
double walked(double sigma, double tau_s, double t_s) {
  return sigma * tau_s * std::sqrt(2 * (t_s / tau_s - 1 + std::exp(-t_s / tau_s)));
}

TEST(Flow, DriftGrowsAsTheIntegralOfItsSlowError) {
  SensorParameters p;
  p.flow_mps = 0.05;
  std::vector<double> early, late;
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    Flow flow(p, seed);
    const Body at_rest;
    Vector place = Vector::Zero();
    // Its error starts at zero: first it becomes what it is.
    for (int ms = 0; ms < 20'000; ++ms) flow.step(at_rest, {});
    for (int ms = 1; ms <= 20'000; ++ms) {
      place += flow.step(at_rest, {}) * step_s;
      if (ms == 5'000) early.insert(early.end(), {place.x(), place.y()});
    }
    late.insert(late.end(), {place.x(), place.y()});
    EXPECT_EQ(place.z(), 0);
  }
  EXPECT_NEAR(deviation(early), walked(0.05, p.flow_s, 5), 0.1 * walked(0.05, p.flow_s, 5));
  EXPECT_NEAR(deviation(late), walked(0.05, p.flow_s, 20), 0.1 * walked(0.05, p.flow_s, 20));
}

TEST(Flow, EachDroneHasAScaleOfItsOwn) {
  SensorParameters p;
  p.flow_mps = 0;
  Body body;
  body.velocity = {1, -2, 0.5};
  std::vector<double> errors;
  for (std::uint64_t seed = 1; seed <= 500; ++seed) {
    Flow flow(p, seed);
    const Vector velocity = flow.step(body, {});
    errors.push_back(velocity.x() - 1);
    EXPECT_NEAR(velocity.y(), -2 * velocity.x(), 1e-9);
    EXPECT_EQ(velocity.z(), 0.5) << "that is not of the camera";
  }
  EXPECT_NEAR(deviation(errors), p.flow_scale, 0.1 * p.flow_scale);
}

TEST(Senses, ADroneThatTrustsAFlowOfAnotherScaleFliesFasterThanItSays) {
  Parameters p = Flight::calm();
  p.sensors.flow_scale = 0.3;
  p.seed = 3;
  Flight flight(p);
  flight.take_off();
  flight.tell("rc 0 60 0 0");
  flight.run(3);
  EXPECT_NEAR(flight.reported("vgx"), 6, 1);
  EXPECT_GT(std::abs(flight.truth().velocity_mps[0] - 0.6), 0.05);
}

TEST(Senses, AnotherScaleALagAndACastAreInTheVelocityThatItReports) {
  Parameters p = Flight::calm();
  p.sensors.flow_scale_offset = -0.3;
  p.sensors.velocity_lag_s = 0.3;
  p.sensors.velocity_truncated = true;
  Flight flight(p);
  flight.take_off();
  flight.tell("rc 0 57 0 0");
  flight.run(0.4);
  const double early = flight.reported("vgx");
  flight.run(3);
  EXPECT_LT(early, 3) << "the drone's own lag, and that of what it reports";
  EXPECT_EQ(flight.reported("vgx"), 5) << "0.57 by its own estimate";
  EXPECT_NEAR(flight.truth().velocity_mps[0], 0.57 / 0.7, 0.05);
}

TEST(Senses, TheReportedVelocityIsItsOwnInWholeDecimetresASecond) {
  Parameters p = Flight::calm();
  p.sensors.flow_noise_mps = 0.02;
  Flight flight(p);
  flight.take_off();
  flight.tell("rc 0 35 0 0");
  flight.run(2);
  flight.states.clear();
  int fours = 0, others = 0;
  for (int i = 0; i < 20; ++i) {
    flight.tell("rc 0 35 0 0");
    flight.run(1);
  }
  for (const Outgoing& state : flight.states) {
    const double reported = std::stod(fields(state.bytes)["vgx"]);
    (reported == 4 ? fours : others)++;
    EXPECT_TRUE(reported == 3 || reported == 4) << reported;
  }
  EXPECT_NEAR(fours, others, 60) << "0.35 m/s with noise is now the one, now the other";
}

TEST(Senses, YawAndVelocityAreAsTheDroneStoodWhenItWasSwitchedOn) {
  Parameters p = Flight::calm();
  p.start_yaw_rad = right_angle;
  Flight flight(p);
  flight.take_off();
  EXPECT_NEAR(flight.truth().yaw_rad, right_angle, 0.01);
  EXPECT_EQ(flight.reported("yaw"), 0);
  flight.tell("rc 0 60 0 0");
  flight.run(3);
  EXPECT_NEAR(flight.truth().velocity_mps[1], 0.6, 0.03) << "it looks north";
  EXPECT_EQ(flight.reported("vgx"), 6) << "where it looked when it was switched on";
  EXPECT_EQ(flight.reported("vgy"), 0);
  ASSERT_EQ(flight.ask("stop"), "ok");
  ASSERT_EQ(flight.ask("cw 90"), "ok");
  flight.tell("rc 0 60 0 0");
  flight.run(3);
  EXPECT_NEAR(flight.reported("yaw"), 90, 3);
  EXPECT_NEAR(flight.truth().velocity_mps[0], 0.6, 0.03) << "it looks east";
  EXPECT_EQ(flight.reported("vgy"), -6) << "right of where it looked first";

  ASSERT_EQ(flight.ask("land"), "ok");
  EXPECT_NEAR(flight.truth().yaw_rad, 0, 0.05);
  flight.simulator.restart(1);
  flight.ask("command");
  flight.run(0.3);
  EXPECT_EQ(flight.reported("yaw"), 0) << "off and on again: this is its zero now";
}

void expect_lost_flow(const Sensing& sensing) {
  Flight flight;
  flight.take_off();
  flight.run(1);
  flight.simulator.set_sensing(1, sensing);
  flight.simulator.set_wind({1, 0, 0});
  const double before = flight.truth().position_m[0];
  flight.run(1);
  flight.states.clear();
  flight.run(5);
  for (const Outgoing& state : flight.states) {
    EXPECT_EQ(fields(state.bytes)["vgx"], "0");
    EXPECT_EQ(fields(state.bytes)["vgy"], "0");
  }
  EXPECT_GT(flight.truth().velocity_mps[0], 0.3);
  EXPECT_GT(flight.truth().position_m[0], before + 2);
  EXPECT_NEAR(flight.truth().position_m[2], 1, 0.05) << "its height it still has";

  flight.simulator.set_sensing(1, {});
  flight.run(0.2);
  EXPECT_GE(flight.reported("vgx"), 2) << "it sees again that it moves";
  flight.simulator.set_wind({});
  flight.run(4);
  EXPECT_NEAR(flight.truth().velocity_mps[0], 0, 0.02);
}

TEST(Senses, InTheDarkADroneDriftsAndSaysThatItStands) { expect_lost_flow({.light = 0.1}); }

TEST(Senses, OverAGlossyFloorADroneDriftsAndSaysThatItStands) { expect_lost_flow({.floor = 0}); }

TEST(Senses, ADroneThatLosesItsFlowInFlightSaysSoonThatItStands) {
  Flight flight;
  flight.take_off();
  flight.tell("rc 0 60 0 0");
  flight.run(2);
  EXPECT_EQ(flight.reported("vgx"), 6);
  flight.simulator.set_sensing(1, {.light = 0});
  flight.run(0.3);
  EXPECT_GT(flight.reported("vgx"), 0) << "it fades";
  flight.run(2);
  EXPECT_EQ(flight.reported("vgx"), 0);
  EXPECT_GT(flight.truth().velocity_mps[0], 0.6) << "its sticks still push, and nothing says that it is fast enough";
}

TEST(Senses, LightThatIsEnoughChangesNothing) {
  const auto bytes = [](double light) {
    Parameters p;
    p.sensing.light = light;
    Flight flight(p);
    flight.take_off();
    flight.run(3);
    return flight.bytes;
  };
  EXPECT_TRUE(bytes(1) == bytes(SensorParameters{}.flow_needs));
  EXPECT_FALSE(bytes(1) == bytes(SensorParameters{}.flow_needs - 0.01));
}

TEST(Senses, ABiasOfItsVelocityCarriesAHoveringDroneAway) {
  Flight flight;
  flight.take_off();
  flight.run(1);
  const double before = flight.truth().position_m[1];
  flight.simulator.set_sensing(1, {.flow_bias_mps = {0, 0.1}});
  flight.run(5);
  EXPECT_NEAR(flight.truth().velocity_mps[1], -0.1, 0.01);
  EXPECT_NEAR(flight.truth().position_m[1], before - 0.5, 0.1);
  EXPECT_EQ(flight.reported("vgy"), 0);
}

TEST(Senses, TofThatSeesNothingSaysSo) {
  Flight flight;
  flight.take_off();
  flight.run(0.2);
  EXPECT_NEAR(flight.reported("tof"), 100, 3);
  flight.simulator.set_sensing(1, {.tof = false});
  flight.run(0.2);
  EXPECT_EQ(flight.reported("tof"), 6553);
  EXPECT_EQ(flight.ask("tof?"), "65530mm\r\n");
  flight.simulator.set_sensing(1, {});
  flight.run(0.2);
  EXPECT_NEAR(flight.reported("tof"), 100, 3);
}

TEST(Senses, TofStepsOverATable) {
  Parameters p = Flight::calm();
  p.tables = {{.x_m = 1.5, .length_m = 1, .width_m = 1, .height_m = 0.4}};
  Flight flight(p);
  flight.take_off();
  EXPECT_NEAR(flight.reported("tof"), 100, 3);
  ASSERT_EQ(flight.ask("forward 150"), "ok");
  flight.run(0.5);
  EXPECT_NEAR(flight.reported("tof"), 60, 3);
  EXPECT_EQ(flight.reported("h"), 100);
  ASSERT_EQ(flight.ask("forward 100"), "ok");
  flight.run(0.5);
  EXPECT_NEAR(flight.reported("tof"), 100, 3);
}

TEST(Senses, ADriftingBarometerTakesTheHeightWithIt) {
  Flight flight;
  flight.ask("command");
  flight.simulator.set_sensing(1, {.baro_drift_mps = 0.1});
  flight.run(3);
  EXPECT_EQ(flight.reported("h"), 0) << "on the ground it knows where it is";
  flight.take_off();
  flight.simulator.set_sensing(1, {});
  const double before = flight.reported("baro"), height = flight.reported("h");
  flight.simulator.set_sensing(1, {.baro_drift_mps = 0.1});
  flight.run(5);
  EXPECT_NEAR(flight.reported("baro"), before + 0.5, 0.03);
  EXPECT_NEAR(flight.reported("h"), height + 50, 10);
  EXPECT_EQ(std::fmod(flight.reported("h"), 10), 0);
  EXPECT_NEAR(flight.reported("tof"), 100, 3);
  EXPECT_NEAR(flight.truth().position_m[2], 1, 0.03);
}

TEST(Senses, TheBarometerWalks) {
  Parameters p = Flight::calm();
  p.sensors.baro_walk_m = 0.005;
  std::vector<double> after;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    Sensors sensors(p, seed);
    const double before = sensors.read({}, {}).barometer_m;
    for (int ms = 0; ms < 60'000; ++ms) sensors.step({.flying = true});
    after.push_back(sensors.read({}, {}).barometer_m - before);
  }
  EXPECT_NEAR(deviation(after), 0.005 * std::sqrt(60), 0.2 * 0.005 * std::sqrt(60));
}

TEST(Senses, TheBatteryFallsFasterNearItsEndAndStillLastsThirteenMinutes) {
  const Parameters p;
  Sensors sensors(p, 1);
  std::vector<double> at_s;
  while (sensors.battery() > 0 && at_s.size() < 1'000) {
    at_s.push_back(sensors.battery());
    for (int ms = 0; ms < 1'000; ++ms) sensors.step({.flying = true});
  }
  EXPECT_NEAR(static_cast<double>(at_s.size()), p.battery.flight_s, 1);
  EXPECT_NEAR((at_s[700] - at_s[720]) / (at_s[100] - at_s[120]), p.battery.sag_factor, 0.01);
}

}  // namespace
}  // namespace ledgerline::sim
