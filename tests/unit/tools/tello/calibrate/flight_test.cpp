#include "tools/tello/core/calibrate/flight.hpp"

#include <gtest/gtest.h>

#include "tests/unit/tools/tello/calibrate/world.hpp"

namespace ledgerline::tello {
namespace {

class ACalibrationFlight : public ::testing::Test {
 protected:
  static Drone full() { return five_drones()[2]; }
  /// In the air and at work.
  static void begin(World& world) {
    world.fly(25);
    ASSERT_TRUE(world.truth().in_flight);
    ASSERT_FALSE(world.flight.over());
  }
  static void expect_down(World& world, const std::string& why) {
    world.fly(100);
    EXPECT_TRUE(world.flight.over());
    EXPECT_FALSE(world.truth().motors_on);
    EXPECT_FALSE(world.flight.aloft());
    EXPECT_NE(world.flight.failure().find(why), std::string::npos) << world.flight.failure();
  }
};

TEST_F(ACalibrationFlight, EndsOnTheGroundWhenItIsAskedTo) {
  for (const double when : {0.5, 0.9, 1.5, 2.0, 3.0, 4.0, 7.0, 9.0, 12.5, 40.0}) {
    World world(full(), {});
    world.fly(when);
    world.flight.end("asked");
    expect_down(world, "asked");
    EXPECT_NEAR(world.truth().position_m[2], 0, 0.01) << when;
  }
}

TEST_F(ACalibrationFlight, LandsOnALowBattery) {
  Drone drone = full();
  drone.parameters.battery.start = 0.33;
  World world(drone, {});
  begin(world);
  expect_down(world, "battery");
}

TEST_F(ACalibrationFlight, DoesNotTakeOffWithALowBatteryOrWithoutPosesThatWereMeant) {
  Drone drone = full();
  drone.parameters.battery.start = 0.25;
  World low(drone, {});
  low.fly();
  EXPECT_NE(low.flight.failure().find("battery"), std::string::npos);
  World blind(full(), {.poses = true});
  blind.seen = false;
  blind.fly();
  EXPECT_NE(blind.flight.failure().find("no pose"), std::string::npos);
  World deaf(full(), {});
  deaf.reaches_drone = false;
  deaf.fly();
  EXPECT_NE(deaf.flight.failure().find("does not answer"), std::string::npos);
  for (World* world : {&low, &blind, &deaf}) {
    EXPECT_TRUE(world->flight.over());
    EXPECT_NEAR(world->truth().position_m[2], 0, 1e-3);
    EXPECT_EQ(world->last_word, "command");
  }
}

TEST_F(ACalibrationFlight, LandsWithoutPosesThatItHad) {
  World world(full(), {.poses = true});
  begin(world);
  world.seen = false;
  expect_down(world, "no pose");
}

TEST_F(ACalibrationFlight, RepeatsLandWhileNothingIsHeardAndReaches) {
  World world(full(), {});
  begin(world);
  world.heard = world.reaches_drone = false;
  world.fly(5);
  EXPECT_EQ(world.last_word, "land");
  world.heard = world.reaches_drone = true;
  expect_down(world, "no state text");
}

TEST_F(ACalibrationFlight, SaysThatItMayBeAloftWhereItIsNotHeardAgain) {
  World world(full(), {});
  begin(world);
  world.heard = world.reaches_drone = false;
  world.fly(100);
  EXPECT_TRUE(world.flight.over());
  EXPECT_TRUE(world.flight.aloft());
  EXPECT_FALSE(world.truth().motors_on) << "by itself, after 15 s";
}

TEST_F(ACalibrationFlight, FliesBackBetweenStrokesWhereItDriftsSlowly) {
  Drone drone = full();
  drone.parameters.sensing.flow_bias_mps = {-0.05, 0};
  World world(drone, {.poses = true});
  while (!world.flight.over()) {
    world.step();
    ASSERT_LT(std::hypot(world.truth().position_m[0], world.truth().position_m[1]), 1.5);
  }
  EXPECT_EQ(world.flight.failure(), "") << "5 cm/s are 7 m in this flight";
}

TEST_F(ACalibrationFlight, LandsWhereItDrifts) {
  Drone drone = full();
  drone.parameters.sensing.flow_bias_mps = {0.25, 0};
  World world(drone, {.poses = true});
  expect_down(world, "away from where it began");
}

TEST_F(ACalibrationFlight, AFastDroneTurnsAroundBeforeItIsFarAway) {
  Drone drone = full();
  drone.parameters.sdk.rc_full_mps = 3;
  World world(drone, {.repeat = 1, .poses = true});
  double furthest = 0;
  while (!world.flight.over()) {
    world.step();
    furthest = std::max({furthest, std::abs(world.truth().position_m[0]), std::abs(world.truth().position_m[1])});
  }
  EXPECT_EQ(world.flight.failure(), "");
  EXPECT_LT(furthest, 2);
  const auto c = estimate(world.flight.record());
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_NEAR(c->along.full_scale.value, 3, 0.3);
}

}  // namespace
}  // namespace ledgerline::tello
