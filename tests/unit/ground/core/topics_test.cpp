#include "ground/core/flight_types.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numbers>

#include "common/base/random.hpp"
#include "common/msg/cdr.hpp"

namespace ledgerline::ground {
namespace {

const DroneTopic& topic(std::string_view name) {
  return *std::find_if(drone_topics.begin(), drone_topics.end(), [&](const auto& t) { return t.name == name; });
}
const PilotTopic& pilot(std::string_view name) {
  return *std::find_if(pilot_topics.begin(), pilot_topics.end(), [&](const auto& t) { return t.name == name; });
}

Odometry sample_odometry() {
  Odometry odometry;
  odometry.header = {1'700'000'000'123'456'789, "map"};
  odometry.child_frame_id = "tello1/base_link";
  odometry.position_m = {1, 2, 3};
  odometry.orientation = {0, 0, 0.6, 0.8};
  return odometry;
}

DroneUpdate sample_update() {
  DroneUpdate update;
  update.state.emplace();
  update.state->sdk_state_fresh = true;
  update.real_ns = 1'700'000'000 * ns_per_s + 5;
  update.state->attitude_rad = {0, 0, std::numbers::pi_v<float> / 2};
  update.state->acceleration_mps2 = {0.5F, -0.25F, 9.75F};
  update.odometry = to_cdr(sample_odometry());
  update.battery = to_cdr(BatteryState{{1'700'000'000 * ns_per_s + 5, "tello1/base_link"}, 0, 0.5F});
  update.transitions = transitions_to_cdr({1, "tello1/base_link"}, "tello1", {Transition{}});
  update.alarm = alarms_to_cdr({1, "tello1/base_link"}, "tello1", {{"chain_broken", true, 1, "x", 7}});
  return update;
}

TEST(Topics, NamesAreTheDronesExceptWhereOneServesAll) {
  EXPECT_EQ(topic_of(topic("/odom"), "tello3"), "/tello3/odom");
  EXPECT_EQ(topic_of(topic("/tf"), "tello3"), "/tf");
  EXPECT_EQ(topic_of(topic("/diagnostics"), "tello3"), "/diagnostics");
}

TEST(Topics, WhatTheLedgerHasGoesOnAsItIs) {
  const DroneUpdate update = sample_update();
  EXPECT_EQ(*topic("/odom").make(update, "tello1"), update.odometry);
  EXPECT_EQ(*topic("/battery").make(update, "tello1"), update.battery);
  EXPECT_EQ(*topic("/diagnostics").make(update, "tello1"), update.transitions);
  EXPECT_EQ(*drone_topics.back().make(update, "tello1"), update.alarm);
  EXPECT_EQ(topic_of(drone_topics.back(), "tello1"), "/diagnostics");
}

TEST(Topics, PoseAndTransformAreTheOdometrys) {
  const DroneUpdate update = sample_update();
  const Odometry odometry = sample_odometry();
  EXPECT_EQ(*topic("/pose").make(update, "tello1"),
            to_cdr(PoseStamped{odometry.header, odometry.position_m, odometry.orientation}));
  EXPECT_EQ(*topic("/tf").make(update, "tello1"),
            to_cdr(std::vector<TransformStamped>{
                {odometry.header, "tello1/base_link", odometry.position_m, odometry.orientation}}));
}

TEST(Topics, TheImuHasTheMomentOfItsState) {
  const std::string message = *topic("/imu").make(sample_update(), "tello1");
  CdrReader in(message);
  EXPECT_EQ(in.get<std::int32_t>(), 1'700'000'000);
  EXPECT_EQ(in.get<std::uint32_t>(), 5U);
  EXPECT_EQ(in.get_string(), "tello1/base_link");
  const auto orientation = in.get_array<double, 4>();
  EXPECT_NEAR(orientation[2], std::sqrt(0.5), 1e-6);
  EXPECT_NEAR(orientation[3], std::sqrt(0.5), 1e-6);
}

TEST(Topics, AnImuOfATelloThatIsSilentIsNotMadeUp) {
  DroneUpdate update = sample_update();
  update.state->sdk_state_fresh = false;
  EXPECT_EQ(*topic("/imu").make(update, "tello1"), "");
}

TEST(Topics, NoNewsAreNoMessages) {
  for (const DroneTopic& one : drone_topics) EXPECT_EQ(*one.make(DroneUpdate{}, "tello1"), "") << one.name;
}

TEST(Topics, WhatIsNoSuchMessageIsAnErrorAndGoesNowhere) {
  DroneUpdate update = sample_update();
  update.odometry.resize(100);
  update.battery.resize(20);
  update.transitions.resize(20);
  update.alarm.resize(20);
  for (const DroneTopic& one : drone_topics) {
    const bool is_of_ground = one.name == "/imu" || &one == &drone_topics[6];  // of what was read already
    EXPECT_EQ(one.make(update, "tello1").ok(), is_of_ground) << one.name;
  }
}

std::string twist_cdr(double forward_mps) {
  CdrWriter out;
  for (const double value : {forward_mps, 0.0, 0.0, 0.0, 0.0, 0.25}) out.put(value);
  return out.release();
}

TEST(Topics, OfVelocitiesTheNewestCountsAndTheOthersAreCounted) {
  PilotCommand command;
  pilot("/cmd_vel").apply(twist_cdr(0.1), 5, command);
  pilot("/cmd_vel").apply(twist_cdr(0.2), 7, command);
  ASSERT_TRUE(command.velocity);
  EXPECT_EQ(command.velocity->linear_mps[0], 0.2);
  EXPECT_EQ(command.velocity->angular_radps[2], 0.25);
  EXPECT_EQ(command.came_ns, 7);
  EXPECT_EQ(command.replaced, 1U);
  pilot("/cmd_vel").apply(twist_cdr(0.3).substr(0, 40), 9, command);
  EXPECT_EQ(command.velocity->linear_mps[0], 0.2);
  EXPECT_EQ(command.malformed, 1U);
}

TEST(Topics, AVelocityThatNobodyCanFlyDoesNotTakeTheWaitingOnesPlace) {
  PilotCommand command;
  pilot("/cmd_vel").apply(twist_cdr(0.1), 5, command);
  pilot("/cmd_vel").apply(twist_cdr(std::numeric_limits<double>::quiet_NaN()), 7, command);
  pilot("/cmd_vel").apply(twist_cdr(-1e9), 8, command);
  EXPECT_EQ(command.velocity->linear_mps[0], 0.1);
  EXPECT_EQ(command.came_ns, 5);
  EXPECT_EQ(command.bad_values, 2U);
  EXPECT_EQ(command.replaced, 0U);
}

TEST(Topics, EachWordIsItsOwn) {
  const auto said = [](std::string_view name) {
    PilotCommand command;
    pilot(name).apply({}, 1, command);
    return std::array{command.takeoff, command.land, command.stop, command.cut};
  };
  EXPECT_EQ(said("/takeoff"), (std::array{true, false, false, false}));
  EXPECT_EQ(said("/land"), (std::array{false, true, false, false}));
  EXPECT_EQ(said("/stop"), (std::array{false, false, true, false}));
  EXPECT_EQ(said("/emergency"), (std::array{false, false, false, true}));
}

}  // namespace
}  // namespace ledgerline::ground
