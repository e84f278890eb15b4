#include "sim/core/sensors.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/unit/sim/flight.hpp"

namespace ledgerline::sim {
namespace {

using testing::HasSubstr;

Parameters above(const std::vector<Pad>& pads) {
  Parameters p = Flight::calm();
  p.pads = pads;
  return p;
}

TEST(Pads, OneBelowIsCommandedInItsOwnFrame) {
  // Its rocket points north: the drone, 0.2 m east and 0.1 m south of it, is behind it and to its right.
  Flight flight(above({{.id = 3, .x_m = -0.2, .y_m = 0.1, .yaw_rad = right_angle}}));
  flight.take_off();
  ASSERT_EQ(flight.ask("mon"), "ok");
  flight.run(0.3);
  EXPECT_EQ(flight.reported("mid"), 3);
  EXPECT_NEAR(flight.reported("x"), -10, 2);
  EXPECT_NEAR(flight.reported("y"), -20, 2);
  EXPECT_NEAR(flight.reported("z"), 100, 3);
  EXPECT_EQ(flight.state()["mpry"], "0,0,90") << "it looks to the right of where the rocket points";
}

TEST(Pads, PlacesAreTrueButForNoise) {
  Parameters p = above({{.id = 1, .x_m = 0.1, .y_m = 0}});
  p.sensors.pad_m = 0.03;
  Flight flight(p);
  flight.take_off();
  flight.ask("mon");
  flight.states.clear();
  for (int i = 0; i < 60; ++i) {
    flight.tell("rc 0 0 0 0");
    flight.run(1);
  }
  double sum = 0, squares = 0;
  for (const Outgoing& state : flight.states) {
    const double error = std::stod(fields(state.bytes)["x"]) / 100 - (flight.truth().position_m[0] - 0.1);
    sum += error;
    squares += error * error;
  }
  const auto count = static_cast<double>(flight.states.size());
  EXPECT_NEAR(count, 600, 3);
  EXPECT_NEAR(sum / count, 0, 0.005);
  EXPECT_NEAR(std::sqrt(squares / count), 0.03, 0.004);
}

TEST(Pads, OnlyWhoLooksSees) {
  Flight flight(above({{.id = 5}}));
  flight.take_off();
  const auto mid = [&](const char* word) {
    if (*word) flight.ask(word);
    flight.run(0.2);
    return flight.reported("mid");
  };
  EXPECT_EQ(mid(""), -2);
  EXPECT_EQ(mid("mon"), 5);
  EXPECT_EQ(mid("mdirection 1"), -1) << "forward";
  EXPECT_EQ(flight.reported("x"), -100);
  EXPECT_EQ(flight.state()["mpry"], "-1,-1,-1");
  EXPECT_EQ(mid("mdirection 0"), 5);
  EXPECT_EQ(mid("mdirection 1"), -1);
  EXPECT_EQ(mid("mdirection 2"), 5) << "both";
  flight.simulator.set_sensing(1, {.pads = false});
  EXPECT_EQ(mid(""), -1) << "covered";
  flight.simulator.set_sensing(1, {});
  EXPECT_EQ(mid("moff"), -2);
}

TEST(Pads, SightEndsWithHeightAndDistance) {
  const Parameters p = above({{.id = 1}, {.id = 2, .x_m = 1}});
  Random random(1);
  const auto seen = [&](double x, double z, double tilt_rad = 0) {
    Body body;
    body.position = {x, 0, z};
    body.attitude = Eigen::AngleAxisd(tilt_rad, Vector::UnitX());
    const auto pad = visible_pad(p, body, random);
    return pad ? pad->id : 0;
  };
  EXPECT_EQ(seen(0, 0.25), 0) << "too low";
  EXPECT_EQ(seen(0, 0.35), 1);
  EXPECT_EQ(seen(0, 1.15), 1);
  EXPECT_EQ(seen(0, 1.25), 0) << "too high";
  EXPECT_EQ(seen(0, 1, 0.4), 0) << "tilted";
  EXPECT_EQ(seen(-0.45, 1), 1);
  EXPECT_EQ(seen(-0.55, 1), 0) << "not all of it is in the picture";
  EXPECT_EQ(seen(-0.45, 0.5), 0);
  EXPECT_EQ(seen(0.55, 1.1), 2) << "the nearest of two";
}

TEST(Pads, GoFliesToAPlaceAboveThePad) {
  Flight flight(above({{.id = 4, .x_m = 0.3, .y_m = 0.2, .yaw_rad = right_angle}}));
  flight.take_off();
  EXPECT_EQ(flight.ask("go 0 0 60 30 m4"), "error") << "it does not look";
  flight.ask("mon");
  EXPECT_EQ(flight.ask("go 0 0 60 30 m2"), "error") << "not this one";
  EXPECT_EQ(flight.ask("go 0 0 60 30 m9"), "error") << "there is none";
  ASSERT_EQ(flight.ask("cw 90"), "ok");
  ASSERT_EQ(flight.ask("go 50 0 80 30 m4"), "ok");
  flight.run(1);
  EXPECT_NEAR(flight.truth().position_m[0], 0.3, 0.05);
  EXPECT_NEAR(flight.truth().position_m[1], 0.7, 0.05) << "where its rocket points";
  EXPECT_NEAR(flight.truth().position_m[2], 0.8, 0.05);
}

TEST(Pads, GoTakesAnyPadToo) {
  Flight flight(above({{.id = 4, .x_m = 0.3}}));
  flight.take_off();
  flight.ask("mon");
  ASSERT_EQ(flight.ask("go 0 0 80 30 m-2"), "ok");
  EXPECT_NEAR(flight.truth().position_m[0], 0.3, 0.1);
  EXPECT_EQ(flight.ask("jump 50 0 80 30 0 m4 m5"), "error") << "not simulated";
}

TEST(Pads, CurveGoesThroughPlacesAboveThePad) {
  Flight flight(above({{.id = 4, .x_m = 0.2, .y_m = 0.2}}));
  flight.take_off();
  flight.ask("mon");
  ASSERT_EQ(flight.ask("curve 80 80 100 180 -20 100 40 m4"), "ok");
  flight.run(1);
  EXPECT_NEAR(flight.truth().position_m[0], 2.0, 0.1);
  EXPECT_NEAR(flight.truth().position_m[1], 0.0, 0.1);
  EXPECT_EQ(flight.ask("curve 80 80 100 180 -20 100 40 m4"), "error") << "out of sight now";
}

TEST(Pads, AreReadFromText) {
  const auto pads = parse_pads("1:0:0,8:1.5:-2:90:0.3");
  ASSERT_TRUE(pads);
  ASSERT_EQ(pads->size(), 2u);
  EXPECT_EQ((*pads)[1].id, 8);
  EXPECT_EQ((*pads)[1].x_m, 1.5);
  EXPECT_EQ((*pads)[1].y_m, -2);
  EXPECT_NEAR((*pads)[1].yaw_rad, right_angle, 1e-9);
  EXPECT_EQ((*pads)[1].size_m, 0.3);
  EXPECT_EQ(pads_text(*pads), "1:0:0:0:0.22,8:1.5:-2:90:0.3");
  EXPECT_TRUE(parse_pads("")->empty());
  for (const char* wrong :
       {"1", "1:0", "0:0:0", "9:0:0", "1.5:0:0", "1:a:0", "1:0:0:0:0", "1:0:0:0:1:1", "1:0:0,", "1:nan:0"}) {
    const auto refused = parse_pads(wrong);
    ASSERT_FALSE(refused) << wrong;
    EXPECT_THAT(refused.error().message, HasSubstr("is no mission pad")) << wrong;
  }
  EXPECT_THAT(parse_pads("1:0:0,1:2:2").error().message, HasSubstr("twice"));
}

}  // namespace
}  // namespace ledgerline::sim
