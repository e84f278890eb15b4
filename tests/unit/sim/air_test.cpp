#include "sim/core/world.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/sim/flight.hpp"

namespace ledgerline::sim {
namespace {

Body hovering() {
  Body body;
  body.position = {0, 0, 5};
  return body;
}

double hover_n() { return BodyParameters{}.mass_kg * gravity_mps2; }

Vector air_below(double down_m, double aside_m) {
  return downwash({}, hovering(), hover_n(), hovering().position + Vector(aside_m, 0, -down_m));
}

TEST(Downwash, IsAFreeJetForItsCoreAndWidensBehind) {
  EXPECT_NEAR(air_below(0.2, 0).z(), -4, 1e-9);
  EXPECT_NEAR(air_below(0.45, 0).z(), -4, 1e-9);
  EXPECT_NEAR(air_below(0.9, 0).z(), -2, 1e-9);
  EXPECT_EQ(air_below(-0.1, 0).norm(), 0) << "not above";
  EXPECT_LT(air_below(0.3, 0.25).norm(), 0.01) << "beside a narrow jet";
  EXPECT_GT(air_below(1.5, 0.25).norm(), 0.5) << "in a wide one";
  EXPECT_GT(air_below(0.68, 0).norm(), 2.5) << "where separation lets another one fly";
}

TEST(Downwash, KeepsItsMomentum) {
  const auto momentum = [](double down_m) {
    double sum = 0;
    for (double r = 0.005; r < 2; r += 0.01) sum += 2 * M_PI * r * 0.01 * air_below(down_m, r).squaredNorm();
    return sum;
  };
  EXPECT_NEAR(momentum(1.5), momentum(0.5), 0.02 * momentum(0.5));
}

TEST(Downwash, GoesWhereTheDroneAboveLeansAwayFrom) {
  Body body = hovering();
  body.attitude = Rotation(Eigen::AngleAxisd(0.3, Vector::UnitY()));  // it leans forward: its jet goes back
  const Vector back = body.position + 0.6 * Vector(-std::sin(0.3), 0, -std::cos(0.3));
  EXPECT_NEAR(downwash({}, body, hover_n(), back).norm(), 3, 1e-6);
  EXPECT_EQ(downwash({}, body, 0, back).norm(), 0) << "motors off";
}

// Two drones one above the other by so much.
struct Stacked {
  explicit Stacked(const Parameters& parameters, double apart_m) : flight(parameters) {
    for (DroneNumber drone = 1; drone <= 2; ++drone) flight.take_off(drone);
    flight.ask(up(apart_m), 20, 2);
    flight.ask("left 300", 20, 1);  // below the other one, which stands 3 m along y
    flight.run(2);
  }
  static Parameters two() {
    Parameters p = Flight::calm();
    p.drones = 2;
    p.columns = 1;
    return p;
  }
  static std::string up(double m) { return "up " + std::to_string(static_cast<int>(100 * m)); }
  Flight flight;
};

TEST(Downwash, PushesTheLowerDroneDownAndAbout) {
  double lowest_m = 9, most_tilt = 0;
  Flight flight(Stacked::two());
  for (DroneNumber drone = 1; drone <= 2; ++drone) flight.take_off(drone);
  flight.ask("up 70", 20, 2);
  flight.tell("left 300", 1);
  for (int i = 0; i < 600; ++i) {
    flight.run(0.01);
    lowest_m = std::min(lowest_m, flight.truth(1).position_m[2]);
    most_tilt = std::max(most_tilt, std::abs(flight.truth(1).tilt_rad));
  }
  EXPECT_LT(lowest_m, 0.93) << "it is pressed down by some centimetres";
  EXPECT_NEAR(flight.truth(2).position_m[2], 1.7, 0.05) << "the upper one feels nothing";
}

TEST(Downwash, DronesBesideEachOtherFlyAsWithout) {
  Parameters p = Stacked::two();
  Parameters without = p;
  without.air.jet_mps = 0;
  Flight one(p), other(without);
  for (Flight* flight : {&one, &other}) {
    for (DroneNumber drone = 1; drone <= 2; ++drone) flight->take_off(drone);
    flight->ask("forward 200");
    flight->run(1);
  }
  EXPECT_EQ(one.bytes, other.bytes);
}

TEST(Downwash, TheSameSeedGivesTheSameBytes) {
  const Stacked one(Stacked::two(), 0.7), other(Stacked::two(), 0.7);
  EXPECT_EQ(one.flight.bytes, other.flight.bytes);
}

TEST(GroundEffect, PullsMoreNearTheGround) {
  Parameters p;
  EXPECT_EQ(ground_effect(p, 0.05), 1) << "none unless it is wanted";
  p.air.ground_effect_radius_m = 0.09;
  EXPECT_EQ(ground_effect(p, 0), 1.25);
  EXPECT_NEAR(ground_effect(p, 0.1), 1.05, 0.01);
  EXPECT_LT(ground_effect(p, 0.3), 1.01);
}

TEST(GroundEffect, ItFloatsOnItsCushionAndLandsAllTheSame) {
  Parameters p = Flight::calm();
  p.air.ground_effect_radius_m = 0.11;
  Flight flight(p), usual;
  double seconds[2];
  for (int i = 0; i < 2; ++i) {
    Flight& f = i == 0 ? flight : usual;
    f.take_off();
    const TimeNs begin = f.now;
    EXPECT_EQ(f.ask("land", 30), "ok");
    seconds[i] = to_seconds(f.now - begin);
  }
  EXPECT_GT(seconds[0], seconds[1] + 0.2) << "it floats";
  EXPECT_LT(seconds[0], 12);
  EXPECT_FALSE(flight.truth().motors_on);
}

}  // namespace
}  // namespace ledgerline::sim
