#include "ground/core/flight_view.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace ledgerline::ground {
namespace {

FlightConfig flight(const std::string& channel, std::vector<FlightDrone> drones) {
  FlightConfig config;
  config.drones = std::move(drones);
  config.manual = true;
  config.where.channel = channel;
  return config;
}

TEST(FlightView, ADroneIsKnownByItsPlaceInTheConfigWhateverItsChannel) {
  const FlightCore teleop(flight("teleop", {{"a", 1}, {"c", 3}}));
  const FlightCore yard(flight("yard", {{"b", 2}}));
  const FlightView view({&teleop, &yard}, {0, 1, 0});
  ASSERT_EQ(view.drones().size(), 3U);
  EXPECT_EQ(view.drones()[0].name, "a");
  EXPECT_EQ(view.drones()[1].name, "b");
  EXPECT_EQ(view.drones()[2].name, "c");
  for (std::size_t drone = 0; drone < 3; ++drone) EXPECT_EQ(view.drone_at(view.slot(drone)), drone);
  EXPECT_EQ(view.channel_of(1), "yard");
  EXPECT_EQ(view.slot(2).drone, 1U);
  EXPECT_EQ(&view.status(2), &teleop.status(1));
  EXPECT_EQ(&view.status(1), &yard.status(0));
}

TEST(FlightView, IsDoneWhenAllChannelsAre) {
  FlightCore teleop(flight("teleop", {{"a", 1}})), yard(flight("yard", {{"b", 2}}));
  const FlightView view({&teleop, &yard}, {0, 1});
  const FlightInputs land{.land = "asked to land", .commands = {}, .states = {}};
  (void)teleop.step(ns_per_s, land);
  ASSERT_TRUE(teleop.done());
  EXPECT_FALSE(view.done()) << "the drones of the other channel still fly";
  (void)yard.step(ns_per_s, land);
  EXPECT_TRUE(view.done());
}

TEST(FlightView, OneFlightIsItsOwn) {
  const FlightCore core(flight("teleop", {{"a", 1}, {"b", 2}}));
  const FlightView view = core;
  EXPECT_EQ(view.channels(), 1U);
  EXPECT_EQ(view.slot(1).drone, 1U);
}

}  // namespace
}  // namespace ledgerline::ground
