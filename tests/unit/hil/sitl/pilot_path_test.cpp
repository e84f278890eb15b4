#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "hil/sitl/world.hpp"

/// Paths that a pilot gives a drone in the air, through ledger, agent and link.
namespace ledgerline::hil {
namespace {

using Order = ground::PilotOrder;

class PilotPathTest : public testing::Test {
 protected:
  void SetUp() override {
    WorldConfig config;
    config.manual = true;
    auto made = SimulatedWorld::create(config);
    ASSERT_TRUE(made) << made.error().message;
    world_ = std::move(*made);
    run(2);
    world_->post_command({.drone = 0, .takeoff = true});
    ASSERT_TRUE(run_until(ground::GroundPhase::manual, 20));
  }

  void run(double seconds) {
    for (const TimeNs end_ns = world_->now() + from_seconds(seconds); world_->now() < end_ns;) step();
  }
  bool run_until(ground::GroundPhase phase, double limit_s) {
    for (const TimeNs end_ns = world_->now() + from_seconds(limit_s); world_->now() < end_ns;) {
      step();
      if (status().phase == phase) return true;
    }
    return false;
  }
  void step() {
    world_->step();
    for (const WorldEvent& event : world_->events()) {
      const bool holds = event.kind == WorldEvent::Kind::mode && world_->drones()[0].mode != FailsafeMode::none;
      troubles_ += holds || event.kind == WorldEvent::Kind::unasked ? 1 : 0;
    }
  }
  void order(Order::Kind kind, std::vector<ground::Waypoint> way = {}, bool land_behind = false) {
    world_->post_command({.drone = 0, .order = Order{kind, std::move(way), land_behind}});
    run(0.1);
  }
  /// From where the drone stood.
  ground::Waypoint at(double x, double y, double z = 1) const {
    const auto& start_m = world_->drones()[0].start_m;
    return {{start_m[0] + x, start_m[1] + y}, z};
  }
  double away_m(const ground::Waypoint& place) const {
    const auto& truth_m = world_->drones()[0].truth.position_m;
    return std::hypot(truth_m[0] - place.at_m.x(), truth_m[1] - place.at_m.y());
  }
  ground::FlightStatus status() const { return world_->ground()->status(0); }

  std::unique_ptr<SimulatedWorld> world_;
  int troubles_ = 0;
};

TEST_F(PilotPathTest, IsFlownPausedResumedAndComesBackAndTheFailsafeHasNothingToDo) {
  troubles_ = 0;
  order(Order::Kind::path, {at(1.5, 0), at(1.5, 1.5), at(0.5, 1.5)});
  ASSERT_EQ(status().phase, ground::GroundPhase::path);
  run(2);
  world_->post_command({.drone = 0, .pause = true});
  run(0.1);
  ASSERT_TRUE(status().paused);
  run(3);
  const auto here_m = world_->drones()[0].truth.position_m;
  run(2);
  const auto& now_m = world_->drones()[0].truth.position_m;
  EXPECT_LT(std::hypot(now_m[0] - here_m[0], now_m[1] - here_m[1]), 0.3) << "it hovers";
  order(Order::Kind::resume);
  ASSERT_TRUE(run_until(ground::GroundPhase::manual, 40));
  EXPECT_LT(away_m(at(0.5, 1.5)), 0.3);
  order(Order::Kind::return_home);
  ASSERT_TRUE(run_until(ground::GroundPhase::manual, 30));
  EXPECT_LT(away_m(at(0, 0)), 0.3);
  order(Order::Kind::path, {at(1, 1)}, true);
  ASSERT_TRUE(run_until(ground::GroundPhase::landed, 40));
  EXPECT_LT(away_m(at(1, 1)), 0.4);
  EXPECT_EQ(status().why, "");
  EXPECT_EQ(status().pilot.refused, 0U);
  EXPECT_EQ(troubles_, 0);
}

}  // namespace
}  // namespace ledgerline::hil
