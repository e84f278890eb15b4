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
  for (const auto shape : {ground::Shape::square, ground::Shape::triangle, ground::Shape::x}) {
    VirtualFlightConfig config;
    config.drones = 3;
    config.laps = 1;
    config.shape = shape;
    const auto flight = fly(config);
    EXPECT_TRUE(flight.ok) << ground::name_of(shape) << ": " << flight.why;
    for (const auto& drone : flight.drones) EXPECT_LT(drone.cross_track_max_m, 0.4) << drone.name;
  }
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
