#include "hil/virtual_flight.hpp"

#include <gtest/gtest.h>

#include "tests/unit/campaign.hpp"

namespace ledgerline::hil {
namespace {

VirtualFlightResult fly(const VirtualFlightConfig& config) {
  auto flight = fly_virtually(config);
  EXPECT_TRUE(flight.ok()) << flight.error().what;
  return flight.ok() ? *flight : VirtualFlightResult{};
}

TEST(VirtualFlight, OneDroneFinishesItsSquareAndLands) {
  VirtualFlightConfig config;
  config.laps = 1;
  const auto flight = fly(config);
  EXPECT_TRUE(flight.ok) << flight.why;
  ASSERT_EQ(flight.drones.size(), 1U);
  EXPECT_EQ(flight.drones[0].lap_s.size(), 1U);
  EXPECT_LT(flight.drones[0].cross_track_max_m, 0.4);
  EXPECT_GT(flight.drones[0].two_way_ms.count, 100U);
}

TEST(VirtualFlight, ThreeDronesFlyEveryShape) {
  for (const auto shape : {ground::Shape::square, ground::Shape::triangle, ground::Shape::x, ground::Shape::eight}) {
    VirtualFlightConfig config;
    config.drones = 3;
    config.laps = 1;
    config.shape = shape;
    const auto flight = fly(config);
    EXPECT_TRUE(flight.ok) << ground::name_of(shape) << ": " << flight.why;
    for (const auto& drone : flight.drones) EXPECT_LT(drone.cross_track_max_m, 0.4) << drone.name;
  }
}

TEST(VirtualFlight, WaypointsAreFlownWithTheirHeightsAndSpeeds) {
  const auto waypoints = motion::waypoints_from_csv("0,0,1\n2,0,1.5,0.4\n2,1,1.5\n1,2\n0,1\n", "way.csv");
  ASSERT_TRUE(waypoints.ok());
  VirtualFlightConfig config;
  config.laps = 1;
  config.speed_mps = 0.8;
  config.waypoints = *waypoints;
  const auto flight = fly(config);
  EXPECT_TRUE(flight.ok) << flight.why;
  EXPECT_LT(flight.drones[0].cross_track_max_m, 0.2);
}

TEST(VirtualFlight, ALocalFlightHasNoLedgerAndFliesTheSamePath) {
  VirtualFlightConfig config;
  config.mode = VirtualFlightConfig::Mode::local;
  config.drones = 2;
  config.laps = 1;
  const auto flight = fly(config);
  EXPECT_TRUE(flight.ok) << flight.why;
  for (const auto& drone : flight.drones) {
    EXPECT_LT(drone.cross_track_max_m, 0.2);
    EXPECT_LT(drone.two_way_ms.max, 5);
    EXPECT_EQ(drone.commands_applied, drone.commands_sent);
  }
  config.delays.added = {AddedDelay::Kind::constant, 1};
  EXPECT_FALSE(fly_virtually(config).ok());
}

TEST(VirtualFlight, TheSameSeedGivesTheSameBytesAndAnotherSeedOthers) {
  VirtualFlightConfig config;
  config.drones = 2;
  config.laps = 1;
  const auto first = fly(config);
  const auto second = fly(config);
  config.seed = 2;
  const auto other = fly(config);
  EXPECT_EQ(first.digest, second.digest);
  EXPECT_NE(first.digest, other.digest);
}

TEST(VirtualFlight, EverySeedFliesItsLapAndLosesNoCommand) {
  for (int seed = 100; seed < 100 + seeds(2, 1000); ++seed) {
    VirtualFlightConfig config;
    config.laps = 1;
    config.seed = static_cast<std::uint64_t>(seed);
    const auto flight = fly(config);
    ASSERT_TRUE(flight.ok) << "seed " << seed << ": " << flight.why;
    EXPECT_LT(flight.drones[0].cross_track_max_m, 0.4) << "seed " << seed;
    EXPECT_EQ(flight.drones[0].commands_applied, flight.drones[0].commands_sent) << "seed " << seed;
  }
}

TEST(VirtualFlight, LatencyIsThatOfTheLedgerTwice) {
  VirtualFlightConfig config;
  config.laps = 1;
  config.delays = {5 * ns_per_ms, 5 * ns_per_ms, 5 * ns_per_ms, 5 * ns_per_ms, 0};
  const auto flight = fly(config);
  EXPECT_TRUE(flight.ok) << flight.why;
  EXPECT_GE(flight.drones[0].two_way_ms.p5, 40.0);
  EXPECT_LE(flight.drones[0].two_way_ms.median, 60.0);
}

}  // namespace
}  // namespace ledgerline::hil
