#include "hil/sitl/simulated_flight.hpp"

#include <gtest/gtest.h>

#include <tuple>

#include "tests/unit/campaign.hpp"

namespace ledgerline::hil {
namespace {

SimulatedFlightResult fly(const SimulatedFlightConfig& config) {
  auto flight = fly_simulated(config);
  EXPECT_TRUE(flight.ok()) << flight.error().message;
  if (!flight) return {};
  EXPECT_EQ(flight->violations, 0U) << "nobody lies here";
  return *flight;
}

TEST(SimulatedFlight, OneDroneFinishesItsSquareAndLands) {
  SimulatedFlightConfig config;
  config.laps = 1;
  const auto flight = fly(config);
  EXPECT_TRUE(flight.ok) << flight.why;
  ASSERT_EQ(flight.drones.size(), 1U);
  EXPECT_EQ(flight.drones[0].lap_s.size(), 1U);
  EXPECT_LT(flight.drones[0].cross_track_max_m, 0.4);
  EXPECT_GT(flight.drones[0].two_way_ms.count, 100U);
}

TEST(SimulatedFlight, ThreeDronesFlyEveryShape) {
  for (const auto shape : {ground::Shape::square, ground::Shape::triangle, ground::Shape::x, ground::Shape::eight}) {
    SimulatedFlightConfig config;
    config.drones = 3;
    config.laps = 1;
    config.shape = shape;
    const auto flight = fly(config);
    EXPECT_TRUE(flight.ok) << ground::name_of(shape) << ": " << flight.why;
    for (const auto& drone : flight.drones) EXPECT_LT(drone.cross_track_max_m, 0.4) << drone.name;
  }
}

// A lap as it should be timed: the reference's own, and the same path without its waypoints' speeds.
struct LapTimes {
  double s = 0, unlimited_s = 0;
};

LapTimes lap_times(const SimulatedFlightConfig& config) {
  auto free = config.waypoints;
  for (auto& waypoint : free) waypoint.speed_mps.reset();
  const auto of = [&](const std::vector<ground::Waypoint>& waypoints) {
    return ground::motion::Track(waypoints, {0, 0}, ground::ControllerConfig{}.height_m, {}).lap_s(config.speed_mps);
  };
  return {of(config.waypoints), of(free)};
}

TEST(SimulatedFlight, WaypointsAreFlownWithTheirHeightsAndSpeeds) {
  // With a first point as high as the flight, and higher.
  for (const auto& [predict, csv, lowest_m, highest_m] :
       {std::tuple{true, "0,0,1\n2,0,1.5,0.2\n2,1,1.5\n1,2\n0,1\n", 1.0, 1.5},
        std::tuple{true, "0,0,1.5\n2,0,1.5,0.2\n2,1,1.5\n1,2,2\n0,1,1.5\n", 1.5, 2.0},
        std::tuple{false, "0,0,1.5\n2,0,1.5,0.2\n2,1,1.5\n1,2,2\n0,1,1.5\n", 1.5, 2.0}}) {
    const auto waypoints = ground::motion::waypoints_from_csv(csv, "way.csv");
    ASSERT_TRUE(waypoints.ok());
    SimulatedFlightConfig config;
    config.laps = 1;
    config.predict = predict;
    config.speed_mps = predict ? 0.8 : 0.5;
    config.waypoints = *waypoints;
    const LapTimes lap = lap_times(config);
    ASSERT_GT(lap.s, 1.3 * lap.unlimited_s);
    const auto flight = fly(config);
    ASSERT_TRUE(flight.ok) << flight.why;
    const auto& drone = flight.drones[0];
    EXPECT_LT(drone.cross_track_max_m, predict ? 0.2 : 0.4);
    // It may begin 0.2 m below its first point.
    EXPECT_NEAR(drone.lowest_m, lowest_m - 0.05, 0.17);
    EXPECT_NEAR(drone.highest_m, highest_m, 0.12);
    ASSERT_EQ(drone.lap_s.size(), 1U);
    EXPECT_NEAR(drone.lap_s[0], lap.s, 0.15 * lap.s);
  }
}

TEST(SimulatedFlight, ALocalFlightHasNoLedgerAndFliesTheSamePath) {
  SimulatedFlightConfig config;
  config.mode = SimulatedFlightConfig::Mode::local;
  config.drones = 2;
  config.laps = 1;
  const auto flight = fly(config);
  EXPECT_TRUE(flight.ok) << flight.why;
  for (const auto& drone : flight.drones) {
    EXPECT_LT(drone.cross_track_max_m, 0.2);
    EXPECT_LT(drone.two_way_ms.max, 5);
    EXPECT_EQ(drone.commands_applied, drone.commands_sent);
  }
  config.delays.added.own = Distribution::constant(ns_per_s);
  EXPECT_FALSE(fly_simulated(config).ok());
}

TEST(SimulatedFlight, TheSameSeedGivesTheSameBytesAndAnotherSeedOthers) {
  SimulatedFlightConfig config;
  config.drones = 2;
  config.laps = 1;
  const auto first = fly(config);
  const auto second = fly(config);
  config.seed = 2;
  const auto other = fly(config);
  EXPECT_EQ(first.digest, second.digest);
  EXPECT_NE(first.digest, other.digest);
}

TEST(SimulatedFlight, EverySeedFliesItsLapAndLosesNoCommand) {
  for (int seed = 100; seed < 100 + seeds(2, 1000); ++seed) {
    SimulatedFlightConfig config;
    config.laps = 1;
    config.seed = static_cast<std::uint64_t>(seed);
    const auto flight = fly(config);
    ASSERT_TRUE(flight.ok) << "seed " << seed << ": " << flight.why;
    EXPECT_LT(flight.drones[0].cross_track_max_m, 0.4) << "seed " << seed;
    EXPECT_EQ(flight.drones[0].commands_applied, flight.drones[0].commands_sent) << "seed " << seed;
  }
}

TEST(SimulatedFlight, LatencyIsThatOfTheLedgerTwice) {
  SimulatedFlightConfig config;
  config.laps = 1;
  config.delays = {5 * ns_per_ms, 5 * ns_per_ms, 5 * ns_per_ms, 5 * ns_per_ms, 0};
  const auto flight = fly(config);
  EXPECT_TRUE(flight.ok) << flight.why;
  EXPECT_GE(flight.drones[0].two_way_ms.p5, 40.0);
  EXPECT_LE(flight.drones[0].two_way_ms.median, 60.0);
}

}  // namespace
}  // namespace ledgerline::hil
