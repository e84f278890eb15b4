#include "tools/tello/core/reception.hpp"

#include <gtest/gtest.h>

#include <string>

namespace ledgerline::tello {
namespace {

constexpr std::string_view state =
    "pitch:0;roll:0;yaw:0;vgx:0;vgy:0;vgz:0;templ:60;temph:62;tof:10;h:0;bat:87;baro:1.0;";
constexpr TimeNs real_ns = 1'800'000'000 * ns_per_s;

ReceivedPose pose_of(TimeNs stamp_ns, TimeNs arrived_ns) {
  PoseStamped pose;
  pose.header = {stamp_ns, "map"};
  pose.position_m = {1, 2, 3};
  return ReceivedPose::of(arrived_ns, pose);
}

TEST(PreflightListening, SilenceIsNoRateAndNoPose) {
  checks::DroneInputs drone;
  Reception().report(ns_per_s, real_ns, true, drone);
  EXPECT_EQ(drone.state_hz, 0.0);
  EXPECT_FALSE(drone.pose.has_value());
  EXPECT_FALSE(drone.battery.has_value());
}

TEST(PreflightListening, AStateTextsRateIsThatOfItsGaps) {
  Reception reception;
  for (int i = 0; i <= 20; ++i) reception.on_state(2 * ns_per_s + i * 100 * ns_per_ms, state);
  reception.on_state(4 * ns_per_s, "no state text");
  checks::DroneInputs drone;
  reception.report(4 * ns_per_s, real_ns, true, drone);
  EXPECT_NEAR(*drone.state_hz, 10, 0.01);
  EXPECT_NEAR(*drone.battery, 0.87, 1e-6);
  EXPECT_TRUE(drone.has_velocity);
  EXPECT_EQ(drone.temperature_c, 62);
  reception.report(14 * ns_per_s, real_ns, true, drone);  // it fell silent
  EXPECT_NEAR(*drone.state_hz, 20.0 / 12, 0.01);
}

TEST(PreflightListening, TextsThatAreNotUnderstoodAreQuoted) {
  Reception reception;
  checks::DroneInputs drone;
  for (int i = 0; i < 10; ++i) reception.on_state(i * 100 * ns_per_ms, "bat: 87;h: 0;\x01\r\n");
  reception.report(ns_per_s, real_ns, true, drone);
  EXPECT_EQ(drone.state_hz, 0.0);
  EXPECT_EQ(drone.unreadable, "bat: 87;h: 0;?");
}

TEST(PreflightListening, AStateTextWithoutVelocitiesIsSeen) {
  Reception reception;
  reception.on_state(ns_per_s, "tof:10;h:0;bat:50;");
  checks::DroneInputs drone;
  reception.report(ns_per_s, real_ns, true, drone);
  EXPECT_FALSE(drone.has_velocity);
  EXPECT_FALSE(drone.temperature_c);
}

TEST(PreflightListening, APoseIsAsOldAsItsStampOrItsArrival) {
  Reception reception;
  // Of a clock that is 2 s ahead, and a network that needs 10 to 30 ms.
  for (int i = 0; i < 100; ++i) {
    const TimeNs measured_ns = real_ns + i * 10 * ns_per_ms;
    reception.on_pose(pose_of(measured_ns + 2 * ns_per_s, measured_ns + (i % 3 + 1) * 10 * ns_per_ms));
  }
  checks::DroneInputs drone;
  const TimeNs now_ns = real_ns + 1010 * ns_per_ms;  // the last, of 990 ms, came at 1000 ms
  reception.report(ns_per_s, now_ns, true, drone);
  ASSERT_TRUE(drone.pose.has_value());
  EXPECT_NEAR(*drone.pose->delay_ms, -1990, 1e-6);
  EXPECT_NEAR(drone.pose->age_ms, -1980, 1e-6);
  EXPECT_NEAR(*drone.pose->rate_hz, 100, 1);
  EXPECT_EQ(drone.pose->frame, "map");
  EXPECT_EQ(drone.pose->position_m, (std::array<double, 3>{1, 2, 3}));
  reception.report(ns_per_s, now_ns, false, drone);
  EXPECT_NEAR(drone.pose->age_ms, 10, 1e-6);
}

TEST(PreflightListening, AFramesNameIsShortAndPrintable) {
  Reception reception;
  PoseStamped pose;
  pose.header.frame_id = "\x1b[2J" + std::string(500, 'x');
  reception.on_pose(ReceivedPose::of(real_ns, pose));
  checks::DroneInputs drone;
  reception.report(ns_per_s, real_ns, true, drone);
  EXPECT_EQ(drone.pose->frame, "?[2J" + std::string(56, 'x'));
}

TEST(PreflightListening, APoseThatAgentRefusesHasItsFault) {
  Reception reception;
  reception.on_pose(pose_of(real_ns, real_ns));
  checks::DroneInputs drone;
  reception.report(real_ns, real_ns, true, drone);
  EXPECT_EQ(drone.pose->fault, "");
  PoseStamped zeros;
  zeros.header = {real_ns, "map"};
  zeros.orientation = {};
  reception.on_pose(ReceivedPose::of(real_ns, zeros));
  reception.report(real_ns, real_ns, true, drone);
  EXPECT_EQ(drone.pose->fault, "its orientation has the length 0.00, not 1");
}

}  // namespace
}  // namespace ledgerline::tello
