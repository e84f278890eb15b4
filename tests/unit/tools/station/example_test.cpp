// The mission of docs/examples is one that may be started where simulated drones stand.
#include <gtest/gtest.h>

#include "common/base/file.hpp"
#include "ground/mission/check.hpp"
#include "ground/mission/mission.hpp"
#include "sim/core/parameters.hpp"

namespace ledgerline::station {
namespace {

using namespace ground::mission;

TEST(TheExampleMission, PassesItsCheckWhereSimulatedDronesStand) {
  const auto text = read_file(LEDGERLINE_SOURCE "/docs/examples/mission-two.csv");
  ASSERT_TRUE(text) << text.error().message;
  const auto two = mission_from_csv(*text, "two");
  ASSERT_TRUE(two) << two.error().message;
  std::vector<DroneNow> now;
  for (int number = 1; number <= 3; ++number) {
    const auto start = sim::start_of({}, number);
    now.push_back({.name = "tello" + std::to_string(number),
                   .seen = true,
                   .on_ground = true,
                   .at_m = Eigen::Vector3d::Map(start.data()),
                   .battery_share = 0.9});
  }
  for (const Finding& finding : check(*two, {.fence = Fence{}}, now)) ADD_FAILURE() << finding.words;
}

}  // namespace
}  // namespace ledgerline::station
