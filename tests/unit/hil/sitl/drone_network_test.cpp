#include "hil/sitl/drone_network.hpp"

#include <gtest/gtest.h>

namespace ledgerline::hil {
namespace {

constexpr TimeNs ms = ns_per_ms;

Impairment::RecordedLink radio(std::string_view table, std::string file = "day.csv") {
  const auto day = parse_link_recording("day.csv", table);
  EXPECT_TRUE(day.ok());
  return {*day, std::move(file), 0};
}

DroneNetwork make_network() {
  Random seeds(1);
  return {seeds, 1};
}

// When what is pushed at `now` comes out, from there; -1: within a second it does not.
int comes_after_ms(DroneNetwork& network, DroneTraffic at, TimeNs now) {
  network.push(now, at, "x");
  for (int i = 0; i < 1000; ++i)
    if (network.pop(now + i * ms, at)) return i;
  return -1;
}

TEST(DroneNetwork, TheRadioIsOfCommandsAnswersAndStates) {
  DroneNetwork drone = make_network();
  drone.set_wifi(radio("0,0.020\n10,0.020\n"));
  for (const DroneTraffic at : {DroneTraffic::to, DroneTraffic::answers, DroneTraffic::states})
    EXPECT_EQ(comes_after_ms(drone, at, ms), 20);
  for (const DroneTraffic at : {DroneTraffic::mocap, DroneTraffic::plans}) EXPECT_EQ(comes_after_ms(drone, at, ms), 0);
}

TEST(DroneNetwork, TheRadioStaysWhileFaultsComeAndGo) {
  DroneNetwork drone = make_network();
  drone.set_wifi(radio("0,0.020\n10,0.020\n"));
  Impairment slow;
  ASSERT_TRUE(apply_effect("delay 100ms", slow));
  drone.impair(DroneTraffic::to, slow);
  EXPECT_EQ(comes_after_ms(drone, DroneTraffic::to, ms), 120);
  drone.impair(DroneTraffic::to, {});
  EXPECT_EQ(comes_after_ms(drone, DroneTraffic::to, 2000 * ms), 20);
  Impairment another;
  another.recorded_link = radio("0,0.050\n10,0.050\n", "another.csv");
  drone.impair(DroneTraffic::to, another);
  EXPECT_EQ(comes_after_ms(drone, DroneTraffic::to, 4000 * ms), 50) << "a fault's own day counts in its place";
}

TEST(DroneNetwork, ItsRecordingGoesOnWhileFaultsComeAndGo) {
  DroneNetwork drone = make_network();
  drone.set_wifi(radio("0,0.010\n1,0.010\n1.001,lost\n2,0.010\n"));
  EXPECT_EQ(comes_after_ms(drone, DroneTraffic::states, 0), 10);
  Impairment slow;
  ASSERT_TRUE(apply_effect("delay 100ms", slow));
  drone.impair(DroneTraffic::states, slow);
  drone.impair(DroneTraffic::states, {});
  EXPECT_EQ(comes_after_ms(drone, DroneTraffic::states, 1500 * ms), -1) << "it has not begun again";
}

}  // namespace
}  // namespace ledgerline::hil
