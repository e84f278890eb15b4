#include "ground/plugin/plugin.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <limits>

#include "ground/core/flight.hpp"
#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr TimeNs first_ns = 5 * ns_per_s;

FollowerTask task_for(const std::string& drone) {
  return {drone, motion::waypoints_of(Shape::square, 1.5), {1, 2}, 0, 2};
}

std::unique_ptr<Follower> odd(const std::string& which) {
  const auto load = load_controller(ODD_CONTROLLER);
  EXPECT_TRUE(load) << load.error().message;
  auto made = (*load)(task_for(which), ControllerConfig{});
  EXPECT_TRUE(made) << made.error().message;
  return std::move(*made);
}

StateSample state_at(TimeNs stamp_ns) {
  StateSample state;
  state.stamp_ns = state.pose_stamp_ns = stamp_ns;
  state.phase = LinkPhase::flying;
  return state;
}

TEST(Plugin, WhatItPlansIsFlownAsItSays) {
  const auto follower = odd("good");
  EXPECT_FALSE(follower->ready()) << "it has seen nothing";
  follower->observe(state_at(1));
  EXPECT_TRUE(follower->ready());
  follower->start(first_ns, 12);
  const auto plan = follower->plan(1, first_ns, 20);
  ASSERT_EQ(plan.size(), 2U);
  EXPECT_EQ(plan[0].at_ns, first_ns);
  EXPECT_EQ(plan[1].at_ns, first_ns + 19 * 50 * ns_per_ms) << "the last one that was asked for";
  EXPECT_FLOAT_EQ(plan[0].velocity_mps[1], 0.2F);
  EXPECT_FLOAT_EQ(plan[0].yaw_rate_radps, 0.4F);
  EXPECT_DOUBLE_EQ(follower->progress_m(), 1.25);
  EXPECT_FALSE(follower->at_end());
  EXPECT_DOUBLE_EQ(follower->lap_m(), 6);
  EXPECT_TRUE(follower->check());
}

TEST(Plugin, NonsenseIsNotFlownAndSaysWhatItIs) {
  const std::pair<const char*, const char*> cases[] = {
      {"nan", "setpoint 2 has nan"},
      {"absurd", "setpoint 1 has 1000000000"},
      {"none", "0 setpoints in a plan; 1 to 40 may be"},
      {"too many", "41 setpoints"},
      {"too early", "first setpoint is 1.000 ms too early"},
      {"too late", "setpoint 2 is 1.000 ms too late"},
      {"twice", "setpoint 2 is not later than the one before"},
      {"progress is nan", "a progress of nan m"},
      {"goes back", "a progress of -1 m"},
      {"beyond", "a progress of 100 m; 0 to 12 may be"},
      {"throws in plan", "plan() threw an exception"},
      {"throws in observe", "observe() threw an exception"},
      {"throws in start", "start() threw an exception"},
  };
  for (const auto& [which, what] : cases) {
    const auto follower = odd(which);
    follower->observe(state_at(1));
    follower->start(first_ns, 12);
    EXPECT_TRUE(follower->plan(1, first_ns, 20).empty()) << which;
    EXPECT_THAT(follower->check().error().message, AllOf(HasSubstr("odd_controller"), HasSubstr(what))) << which;
    EXPECT_EQ(follower->check().error().message.find('\x1b'), std::string::npos) << "its name is somebody else's text";
    EXPECT_TRUE(follower->plan(2, first_ns, 20).empty()) << which << ": it is not asked again";
  }
}

TEST(Plugin, AProgressWithoutEndIsRefusedWhereTheFlightHasNone) {
  const auto follower = odd("endless");
  follower->observe(state_at(1));
  follower->start(first_ns, std::numeric_limits<double>::infinity());
  EXPECT_TRUE(follower->plan(1, first_ns, 20).empty());
  EXPECT_THAT(follower->check().error().message, HasSubstr("a progress of inf m; 0 to 50 may be"));
}

TEST(Plugin, OneThatHasNoPlanIsNoProblem) {
  const auto follower = odd("silent");
  follower->observe(state_at(1));
  EXPECT_TRUE(follower->plan(1, first_ns, 20).empty());
  EXPECT_TRUE(follower->check());
}

TEST(Plugin, WhatIsNoControllerIsRefusedByName) {
  const std::string text = testing::TempDir() + "/no_library.so";
  std::ofstream(text) << "no library\n";
  const std::pair<std::string, const char*> cases[] = {
      {"/nowhere/my.so", "there is no file /nowhere/my.so"},
      {text, "no_library.so cannot be loaded"},
      {OLD_CONTROLLER, "is made for version 0 of the interface, this program has version 1: build it again"},
      {LACKING_CONTROLLER, "lacks its name or one of create, start, observe, plan, destroy"},
      {NO_CONTROLLER, "has no ledgerline_controller()"},
  };
  for (const auto& [file, why] : cases) {
    const auto loaded = load_controller(file);
    ASSERT_FALSE(loaded) << file;
    EXPECT_THAT(loaded.error().message, HasSubstr(why));
  }
  const auto load = load_controller(ODD_CONTROLLER);
  EXPECT_THAT((*load)(task_for("refuses"), {}).error().message, HasSubstr("does not fly refuses (6.0 m a lap)"));
  EXPECT_THAT((*load)(task_for("throws in create"), {}).error().message, HasSubstr("create() threw an exception"));
}

FlightConfig config_with(const std::string& file) {
  FlightConfig config = config_for(1);
  auto load = load_controller(file);
  EXPECT_TRUE(load) << load.error().message;
  config.follower = std::move(*load);
  return config;
}

TEST(Plugin, ADroneWhoseControllerSaysNonsenseIsLanded) {
  FlightConfig config = config_with(ODD_CONTROLLER);
  config.drones[0].name = "nan";
  FlightWorld world(config);
  world.run(60);
  const FlightStatus status = world.core.status(0);
  EXPECT_TRUE(world.core.done());
  EXPECT_FALSE(world.core.ok());
  EXPECT_EQ(status.phase, GroundPhase::landed);
  EXPECT_THAT(status.why, HasSubstr("setpoint 2 has nan, which no drone can fly"));
}

TEST(Plugin, ADroneThatItDoesNotFlyStaysOnTheGround) {
  FlightConfig config = config_with(ODD_CONTROLLER);
  config.drones[0].name = "refuses";
  FlightWorld world(config);
  world.run(60);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::failed);
  EXPECT_THAT(world.core.why(), HasSubstr("does not fly refuses"));
  EXPECT_TRUE(world.drones[0].plans.empty());
}

TEST(Plugin, TheExampleFliesASquare) {
  FlightWorld world(config_with(EXAMPLE_CONTROLLER));
  world.run(120);
  EXPECT_TRUE(world.core.ok()) << world.core.why();
  EXPECT_EQ(world.core.status(0).lap_s.size(), 1U);
}

}  // namespace
}  // namespace ledgerline::ground
