#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

using testing::HasSubstr;
using Order = PilotOrder::Kind;

FlightConfig order_config(int drones = 1) {
  FlightConfig config = config_for(drones);
  config.manual = true;
  return config;
}

Waypoint at(double x, double y, double z = 1) { return {{x, y}, z}; }

PilotCommand order(Order kind) { return {.drone = 0, .order = PilotOrder{kind, {}, false}}; }
PilotCommand path(std::vector<Waypoint> way, bool land_behind = false) {
  return {.drone = 0, .order = PilotOrder{Order::path, std::move(way), land_behind}};
}

/// In the air and still, above (0, 1).
struct InAir : FlightWorld {
  explicit InAir(FlightConfig config = order_config(), bool predict = true) : FlightWorld(with(config, predict)) {
    run(1);
    say({.drone = 0, .takeoff = true});
    run(5);
  }
  static FlightConfig with(FlightConfig config, bool predict) {
    config.controller.predict = predict;
    return config;
  }
  const Eigen::Vector3d& position() const { return drones[0].model.motion.position_m; }
  double away_m(double x, double y, double z = 1) const { return (position() - Eigen::Vector3d(x, y, z)).norm(); }
  FlightStatus status() const { return core.status(0); }
  GroundPhase phase() const { return core.status(0).phase; }
  /// Runs until it is as near to this place as that; false: it never was, within a minute.
  bool passes(double x, double y, double near_m) {
    for (int i = 0; i < 3'000; ++i) {
      if (std::hypot(position().x() - x, position().y() - y) < near_m) return true;
      run(0.02);
    }
    return false;
  }
  /// Runs until it flies no path any more; false: it does after a minute.
  bool ends_path() {
    for (int i = 0; i < 600 && phase() == GroundPhase::path; ++i) run(0.1);
    return phase() != GroundPhase::path;
  }
  const DronePlan& newest_plan() const { return drones[0].plans.back(); }
};

std::string last_note(const FlightWorld& world) { return world.notes.empty() ? "" : world.notes.back(); }

bool hovers(const DronePlan& plan) {
  return plan.action() == FLY && plan.body_frame() &&
         std::all_of(plan.setpoints().begin(), plan.setpoints().end(),
                     [](const auto& s) { return s.vx() == 0 && s.vy() == 0 && s.vz() == 0; });
}

TEST(PilotOrder, AnOpenPathIsFlownThroughItsWaypointsAndTheDroneHoversAtItsEnd) {
  for (const bool predict : {true, false}) {
    InAir world(order_config(), predict);
    world.say(path({at(2, 1), at(2, 3, 1.5), at(1, 3)}));
    EXPECT_EQ(world.phase(), GroundPhase::path);
    EXPECT_EQ(world.calls.back().plans(0).action(), FLY) << "at once";
    EXPECT_FALSE(world.calls.back().plans(0).body_frame()) << "a path is the map's";
    ASSERT_EQ(world.status().planned.size(), 4U);
    EXPECT_NEAR(world.status().planned[0][1], 1, 0.01);
    EXPECT_EQ(world.status().planned[2], (std::array<double, 3>{2, 3, 1.5}));
    EXPECT_TRUE(world.passes(2, 1, 0.15));
    EXPECT_FALSE(world.newest_plan().body_frame());
    EXPECT_TRUE(world.passes(2, 3, 0.15));
    EXPECT_GT(world.position().z(), 1.3);
    EXPECT_GT(world.status().progress, 0.5);
    EXPECT_EQ(world.status().paths, 1U);
    EXPECT_GE(world.status().reached, 1U);
    EXPECT_LT(world.status().reached, 3U);
    ASSERT_TRUE(world.ends_path());
    EXPECT_EQ(world.status().reached, 3U);
    EXPECT_EQ(world.phase(), GroundPhase::manual);
    world.run(3);
    EXPECT_LT(world.away_m(1, 3), 0.2);
    EXPECT_TRUE(hovers(world.newest_plan()));
    EXPECT_TRUE(world.status().planned.empty());
    EXPECT_EQ(world.status().progress, 1);
    EXPECT_EQ(world.phase(), GroundPhase::manual);
    EXPECT_TRUE(world.core.ok()) << world.core.why();
    EXPECT_TRUE(world.notes.empty()) << world.notes.front();
  }
}

TEST(PilotOrder, OneWaypointIsAPlaceToGoToAlsoStraightAbove) {
  InAir world;
  world.say(path({at(1.5, 2)}));
  ASSERT_TRUE(world.ends_path());
  EXPECT_LT(world.away_m(1.5, 2), 0.15);
  const Eigen::Vector3d here = world.position();
  world.say(path({at(here.x() + 0.005, here.y(), 2)}));
  ASSERT_TRUE(world.ends_path());
  EXPECT_LT(world.away_m(here.x(), here.y(), 2), 0.25);
  EXPECT_EQ(world.status().reached, 1U);
  world.say(path({at(world.position().x(), world.position().y(), 1), at(0, 1)}));
  ASSERT_TRUE(world.ends_path());
  EXPECT_LT(world.away_m(0, 1), 0.15) << "from a place that is the first waypoint";
  EXPECT_TRUE(world.notes.empty());
}

TEST(PilotOrder, AWaypointWithoutAHeightIsAtTheFlights) {
  FlightConfig config = order_config();
  config.controller.height_m = 1.7;
  InAir world(config);
  world.say(path({{{1, 1}}}));
  ASSERT_TRUE(world.ends_path());
  EXPECT_LT(world.away_m(1, 1, 1.7), 0.25);
}

TEST(PilotOrder, ItLandsBehindThePathWhereItIsAskedTo) {
  InAir world;
  world.say(path({at(1.5, 1)}, true));
  world.run(15);
  EXPECT_EQ(world.phase(), GroundPhase::landed);
  EXPECT_LT(world.away_m(1.5, 1, 0), 0.2);
  EXPECT_TRUE(world.core.ok()) << world.core.why();
  EXPECT_TRUE(world.status().planned.empty());
}

TEST(PilotOrder, APauseHoldsAndResumeGoesOnToTheNextWaypoint) {
  InAir world;
  world.say(path({at(2, 1), at(2, 3), at(0, 3)}, true));
  ASSERT_TRUE(world.passes(2, 2, 0.3));
  world.say({.drone = 0, .pause = true});
  EXPECT_EQ(world.phase(), GroundPhase::manual);
  EXPECT_TRUE(world.status().paused);
  EXPECT_EQ(world.status().planned.size(), 4U) << "it is shown while it waits";
  world.run(2);
  const Eigen::Vector3d here = world.position();
  EXPECT_TRUE(hovers(world.newest_plan()));
  world.run(5);
  EXPECT_LT((world.position() - here).norm(), 0.02);
  world.say({.drone = 0, .pause = true});
  EXPECT_THAT(last_note(world), HasSubstr("no pause: it is paused already"));

  world.say(order(Order::resume));
  EXPECT_EQ(world.phase(), GroundPhase::path);
  EXPECT_FALSE(world.status().paused);
  ASSERT_EQ(world.status().planned.size(), 3U) << "the first waypoint is behind it";
  EXPECT_EQ(world.status().planned[1], (std::array<double, 3>{2, 3, 1}));
  EXPECT_TRUE(world.passes(2, 3, 0.15));
  world.run(20);
  EXPECT_LT(world.away_m(0, 3, 0), 0.2);
  EXPECT_EQ(world.phase(), GroundPhase::landed) << "as the path was to end";
}

TEST(PilotOrder, PausedBeforeAWaypointItFliesThereWhenResumedWhereverItWasFlownMeanwhile) {
  InAir world;
  world.say(path({at(2, 1), at(2, 3)}));
  ASSERT_TRUE(world.passes(1, 1, 0.2));
  world.say({.drone = 0, .pause = true});
  for (int i = 0; i < 20; ++i) {
    world.say({.drone = 0, .velocity = Twist{{0, -0.5, 0}, {}}});
    world.run(0.1);
  }
  EXPECT_LT(world.position().y(), 0.5) << "a pilot may fly it while it is paused";
  EXPECT_TRUE(world.status().paused);
  world.say(order(Order::resume));
  EXPECT_EQ(world.status().planned.size(), 3U);
  EXPECT_TRUE(world.passes(2, 1, 0.15));
  ASSERT_TRUE(world.ends_path());
  EXPECT_LT(world.away_m(2, 3), 0.15);
}

TEST(PilotOrder, WhatIsPausedIsForgottenBehindAnotherPathAndBehindALanding) {
  InAir world;
  world.say(path({at(3, 1)}));
  world.run(2);
  world.say({.drone = 0, .pause = true});
  world.say(path({at(0, 2)}));
  EXPECT_FALSE(world.status().paused);
  ASSERT_TRUE(world.ends_path());
  world.say(order(Order::resume));
  EXPECT_THAT(last_note(world), HasSubstr("no resume: no path of it is paused"));
  world.run(2);
  world.say(path({at(3, 1)}));
  world.run(2);
  world.say({.drone = 0, .pause = true});
  world.say({.drone = 0, .land = true});
  EXPECT_FALSE(world.status().paused);
  EXPECT_TRUE(world.status().planned.empty());
  world.run(5);
  world.say({.drone = 0, .takeoff = true});
  world.run(5);
  world.say(order(Order::resume));
  EXPECT_THAT(last_note(world), HasSubstr("no resume"));
  EXPECT_EQ(world.phase(), GroundPhase::manual);
}

TEST(PilotOrder, ItReturnsToWhereItTookOffAtTheHeightThatItHas) {
  InAir world;
  world.say(path({at(2, 2, 1.6)}));
  ASSERT_TRUE(world.ends_path());
  const double height_m = world.position().z();
  world.say(order(Order::return_home));
  EXPECT_EQ(world.phase(), GroundPhase::path);
  ASSERT_TRUE(world.ends_path());
  EXPECT_EQ(world.phase(), GroundPhase::manual);
  EXPECT_LT(world.away_m(0, 1, height_m), 0.2);
  EXPECT_TRUE(world.notes.empty());
}

TEST(PilotOrder, OfADroneFoundInTheAirNobodyKnowsWhereItTookOff) {
  FlightWorld world(order_config());
  world.drones[0].phase = LinkPhase::flying;
  world.drones[0].model.motion.stamp_ns = world.now_ns;
  world.drones[0].model.motion.position_m = {5, 5, 1};
  world.run(1);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::manual);
  world.say(order(Order::return_home));
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
  EXPECT_THAT(last_note(world), HasSubstr("no return: where it took off is not known"));
  world.say(path({at(5, 4)}));
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::path) << "where it is it knows";
}

TEST(PilotOrder, OnTheGroundAndOnItsWayUpAndDownOrdersAreRefusedInWords) {
  FlightWorld world(order_config());
  world.run(1);
  world.say(path({at(1, 1)}));
  ASSERT_EQ(world.notes.size(), 1U);
  EXPECT_THAT(world.notes[0], HasSubstr("tello1: no path: it is not in the air"));
  EXPECT_EQ(world.core.status(0).pilot.refused, 1U);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::waiting);
  world.run(1);
  world.say({.drone = 0, .takeoff = true});
  world.run(1);
  world.say(path({at(1, 1)}));
  EXPECT_THAT(last_note(world), HasSubstr("no path: it is still taking off"));
  world.run(5);
  world.say({.drone = 0, .land = true});
  world.run(0.5);
  world.say(order(Order::return_home));
  EXPECT_THAT(last_note(world), HasSubstr("no return: it is landing"));
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::landing);
}

TEST(PilotOrder, AFlightAroundItsOwnPathTakesNoOrder) {
  FlightWorld world(config_for(1));
  world.run(10);
  ASSERT_EQ(world.core.status(0).phase, GroundPhase::path);
  ASSERT_EQ(world.core.status(0).planned.size(), 5U) << "a square, closed";
  EXPECT_EQ(world.core.status(0).planned.front(), world.core.status(0).planned.back());
  for (const PilotCommand& command :
       {order(Order::path), order(Order::resume), order(Order::return_home), PilotCommand{.drone = 0, .pause = true}}) {
    world.say(command);
    EXPECT_THAT(last_note(world), HasSubstr("it flies the path of its flight"));
    EXPECT_EQ(world.core.status(0).phase, GroundPhase::path);
    world.run(1.1);
  }
  world.run(60);
  EXPECT_TRUE(world.core.ok()) << world.core.why();
  EXPECT_TRUE(world.core.status(0).planned.empty());
}

TEST(PilotOrder, WithoutAPoseNoPathIsFlown) {
  InAir blind;
  blind.drones[0].has_pose = false;
  blind.run(0.2);
  for (const auto& command : {path({at(1, 1)}), order(Order::return_home)}) {
    blind.say(command);
    EXPECT_THAT(last_note(blind), HasSubstr("it has no pose"));
    EXPECT_EQ(blind.phase(), GroundPhase::manual);
    blind.run(1.1);
  }
  EXPECT_EQ(blind.status().pilot.refused, 2U);
}

TEST(PilotOrder, AnOldPoseIsNoPlaceToBeginAt) {
  InAir world;
  world.drones[0].pose_late_ns = 2 * ns_per_s;
  world.run(0.2);
  world.say(path({at(1, 1)}));
  EXPECT_THAT(last_note(world), HasSubstr("no path: its pose is lost"));
  EXPECT_EQ(world.phase(), GroundPhase::manual);
}

TEST(PilotOrder, APoseAgesWhileNoStateComes) {
  InAir world;
  world.drones[0].silent = true;
  world.run(0.9);
  world.say(path({at(1, 1)}));
  EXPECT_THAT(last_note(world), HasSubstr("no path: its pose is lost"));
  EXPECT_EQ(world.phase(), GroundPhase::manual);
}

TEST(PilotOrder, WhileItsFailsafeBrakesItNoPathIsBegun) {
  InAir world;
  world.drones[0].mode = FailsafeMode::brake;
  world.drones[0].cause = FailsafeCause::ledger_untrusted;
  world.run(0.2);
  world.say(path({at(1, 1)}));
  EXPECT_THAT(last_note(world), HasSubstr("no path: its failsafe brakes it"));
  EXPECT_EQ(world.phase(), GroundPhase::manual);
}

TEST(PilotOrder, WithoutAPoseTheReferenceWaitsAlsoWithoutPrediction) {
  InAir world(order_config(), false);
  world.say(path({at(4, 1)}));
  ASSERT_TRUE(world.passes(1, 1, 0.2));
  const double progress = world.status().progress;
  world.drones[0].pose_late_ns = 2 * ns_per_s;
  world.run(0.2);
  const double when_lost = world.status().progress;
  world.run(2);
  EXPECT_LT(when_lost, progress + 0.1);
  EXPECT_EQ(world.status().progress, when_lost);
}

TEST(PilotOrder, APauseHoldsBesideAnyOrderOfTheSameStep) {
  InAir world;
  PilotCommand both = path({at(2, 1)});
  both.pause = true;
  world.say(both);
  EXPECT_EQ(world.phase(), GroundPhase::manual);
  EXPECT_TRUE(world.status().paused);
  EXPECT_EQ(world.status().planned.back(), (std::array<double, 3>{2, 1, 1})) << "the new path waits";
  both = order(Order::resume);
  both.pause = true;
  world.say(both);
  EXPECT_TRUE(world.status().paused);
  EXPECT_TRUE(world.notes.empty()) << world.notes.back();
}

TEST(PilotOrder, AStickThatIsMovedPausesThePathAndOneAtRestDoesNot) {
  InAir world;
  world.say(path({at(4, 1)}));
  world.run(2);
  world.say({.drone = 0, .velocity = Twist{{0.01, 0, 0}, {}}, .came_ns = world.now_ns});
  EXPECT_EQ(world.phase(), GroundPhase::path);
  world.say({.drone = 0, .velocity = Twist{{0, 0.4, 0}, {}}, .came_ns = world.now_ns});
  EXPECT_EQ(world.phase(), GroundPhase::manual);
  EXPECT_TRUE(world.status().paused);
  EXPECT_THAT(last_note(world), HasSubstr("its pilot flies it by hand"));
  world.run(0.2);
  EXPECT_GT(world.newest_plan().setpoints(0).vy(), 0.3) << "and is flown";
  world.say(order(Order::resume));
  ASSERT_TRUE(world.ends_path());
  EXPECT_LT(world.away_m(4, 1), 0.15);
}

TEST(PilotOrder, ALandingThatChangesNothingIsRefusedInWords) {
  FlightWorld world(order_config());
  world.run(1);
  world.say({.drone = 0, .land = true});
  EXPECT_THAT(last_note(world), HasSubstr("no landing: it is on the ground"));
}

TEST(PilotOrder, AFlightAlongAPathThatWaitsIsEndedByALandingAndByAStop) {
  for (const bool stop : {false, true}) {
    FlightWorld world(config_for(1));
    world.drones[0].has_pose = false;  // so that it waits
    world.run(1);
    ASSERT_EQ(world.core.status(0).phase, GroundPhase::waiting);
    world.say({.drone = 0, .land = !stop, .stop = stop});
    EXPECT_EQ(world.core.status(0).phase, GroundPhase::failed);
    EXPECT_THAT(world.core.status(0).why, HasSubstr(stop ? "stopped by Org2MSP CN=User1@org2" : "its pilot"));
    world.drones[0].has_pose = true;
    world.run(10);
    EXPECT_EQ(world.drones[0].phase, LinkPhase::on_ground) << "it never takes off";
  }
}

TEST(PilotOrder, VelocitiesThatWereHeldBackAreReportedAndNotFlown) {
  InAir world;
  world.say({.drone = 0, .late = 3});
  EXPECT_THAT(last_note(world), HasSubstr("held back on its way"));
  EXPECT_EQ(world.status().pilot.late, 3U);
  EXPECT_TRUE(hovers(world.newest_plan()));
}

TEST(PilotOrder, WhileAStopIsOnItsWayNothingTakesOff) {
  FlightWorld world(order_config());
  world.run(1);
  const crypto::IdentityName alice{"Org2MSP", "CN=alice"};
  std::vector<PilotCommand> commands{{.drone = 0, .takeoff = true}, {.drone = 0, .by = alice, .stop = true}};
  FlightInputs inputs;
  inputs.commands = commands;
  const FlightOutputs out = world.core.step(world.now_ns, inputs);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::waiting);
  ASSERT_EQ(out.notes.size(), 1U);
  EXPECT_THAT(out.notes[0], HasSubstr("a stop of it is on its way"));
  ASSERT_EQ(out.submissions.size(), 1U);
  EXPECT_EQ(out.submissions[0].by, alice);
}

TEST(PilotOrder, AVelocityOfBeforeIsNotFlownBehindAPathThatEndsAtOnce) {
  InAir world;
  world.say({.drone = 0, .velocity = Twist{{0.1, 0, 0}, {}}});
  world.run(0.05);
  const Eigen::Vector3d here = world.position();
  world.say(path({at(here.x(), here.y(), here.z())}));
  world.run(0.1);
  ASSERT_EQ(world.phase(), GroundPhase::manual);
  EXPECT_TRUE(hovers(world.newest_plan()));
}

TEST(PilotOrder, WhatWasLearnedOfTheDroneHoldsForItsNextPath) {
  InAir world;
  world.say(path({at(3, 1), at(3, 4), at(0, 4), at(0, 1)}));
  const motion::Response first = world.status().response;
  ASSERT_TRUE(world.ends_path());
  const motion::Response learned = world.status().response;
  ASSERT_NE(learned.lag_s, first.lag_s);
  world.say(path({at(2, 1)}));
  EXPECT_EQ(world.status().response.lag_s, learned.lag_s);
}

TEST(PilotOrder, BadWaypointsAreRefusedAndThePathThatIsFlownGoesOn) {
  InAir world;
  world.say(path({at(2, 1)}));
  world.run(1);
  world.say(path({at(1, 1), at(1, 2, 0.1)}));
  EXPECT_THAT(last_note(world), HasSubstr("no path: waypoint 2 has z 0.1 m"));
  world.say(path({}));
  EXPECT_EQ(world.status().pilot.refused, 2U);
  EXPECT_EQ(world.phase(), GroundPhase::path);
  ASSERT_TRUE(world.ends_path());
  EXPECT_LT(world.away_m(2, 1), 0.15);
}

TEST(PilotOrder, ALandingInTheMiddleOfAPathLandsThereAndBeatsAnOrder) {
  InAir world;
  world.say(path({at(4, 1)}));
  ASSERT_TRUE(world.passes(1, 1, 0.2));
  PilotCommand both = path({at(0, 5)});
  both.land = true;
  world.say(both);
  EXPECT_EQ(world.phase(), GroundPhase::landing);
  world.run(5);
  EXPECT_EQ(world.phase(), GroundPhase::landed);
  EXPECT_LT(world.position().x(), 2);
  EXPECT_LT(world.position().y(), 1.2);
  EXPECT_TRUE(world.core.ok()) << world.core.why();
  EXPECT_EQ(world.status().pilot.refused, 0U);
}

TEST(PilotOrder, AStopInTheMiddleOfAPathStops) {
  InAir world;
  world.say(path({at(4, 1)}));
  world.run(2);
  world.say({.drone = 0, .stop = true});
  EXPECT_EQ(world.stops.size(), 1U);
  world.run(5);
  EXPECT_EQ(world.phase(), GroundPhase::landed);
}

TEST(PilotOrder, ASticksNoiseAndATakeOffDuringAPathChangeNothing) {
  InAir world;
  world.say(path({at(2, 1)}));
  for (int i = 0; i < 10; ++i) {
    world.say({.drone = 0, .velocity = Twist{{0, 0.02, 0}, {}}});
    world.run(0.1);
  }
  EXPECT_EQ(world.status().pilot.not_flying, 10U);
  EXPECT_EQ(world.status().pilot.velocities, 0U);
  world.say({.drone = 0, .takeoff = true});
  EXPECT_THAT(last_note(world), HasSubstr("no take-off: it is in the air"));
  EXPECT_LT(std::abs(world.position().y() - 1), 0.1);
  ASSERT_TRUE(world.ends_path());
  EXPECT_LT(world.away_m(2, 1), 0.15);
  world.run(1);
  EXPECT_LT(world.away_m(2, 1), 0.15) << "no velocity of before is flown behind the path";
}

TEST(PilotOrder, ANewPathReplacesTheOneThatIsFlown) {
  InAir world;
  world.say(path({at(4, 1)}));
  ASSERT_TRUE(world.passes(1, 1, 0.2));
  world.say(path({at(1, 3)}));
  ASSERT_EQ(world.status().planned.size(), 2U);
  EXPECT_LT(world.status().progress, 0.1);
  double farthest_m = 0;
  while (world.phase() == GroundPhase::path) {
    world.run(0.1);
    farthest_m = std::max(farthest_m, world.position().x());
  }
  EXPECT_LT(farthest_m, 1.6);
  EXPECT_LT(world.away_m(1, 3), 0.15);
}

TEST(PilotOrder, WhileItsPoseIsLostThePathWaits) {
  InAir world;
  world.say(path({at(4, 1)}));
  ASSERT_TRUE(world.passes(1, 1, 0.2));
  const double before = world.status().progress;
  world.drones[0].pose_late_ns = 2 * ns_per_s;
  world.run(2);
  EXPECT_LT(world.status().progress, before + 0.15);
  EXPECT_EQ(world.phase(), GroundPhase::path);
}

TEST(PilotOrder, APathThatTakesTooLongEndsInAHoverAndIsReported) {
  FlightConfig config = order_config();
  config.limits.path_factor = 0;  // half a minute
  config.controller.full_scale_mps = 0.1;
  InAir world(config);
  world.say(path({at(50, 1)}, true));
  world.run(29);
  EXPECT_EQ(world.phase(), GroundPhase::path);
  world.run(2);
  EXPECT_EQ(world.phase(), GroundPhase::manual);
  EXPECT_EQ(last_note(world), "tello1: did not finish its path within 30 s: it hovers");
  world.run(2);
  EXPECT_TRUE(hovers(world.newest_plan()));
  EXPECT_TRUE(world.core.ok()) << world.core.why();
}

TEST(PilotOrder, ALostLeaseEndsThePathAndHandedBackTheDroneHovers) {
  InAir world;
  world.say(path({at(4, 1)}));
  world.run(2);
  ASSERT_TRUE(world.core.set_control(control_record("tello1", outsider_name, 2).SerializeAsString()));
  world.run(1);
  EXPECT_EQ(world.phase(), GroundPhase::waiting);
  EXPECT_TRUE(world.status().planned.empty());
  world.say(path({at(4, 1)}));
  EXPECT_THAT(last_note(world), HasSubstr("no path: its lease is held by CN=User1@org3"));
  ASSERT_TRUE(world.core.set_control(control_record("tello1", operator_name, 3).SerializeAsString()));
  world.run(1);
  EXPECT_EQ(world.phase(), GroundPhase::manual);
  EXPECT_TRUE(hovers(world.newest_plan()));
}

TEST(PilotOrder, TheFlightsTimeIsNoPathsTime) {
  FlightConfig config = order_config();
  config.seconds = 20;
  InAir world(config);
  world.say(path({at(1, 1)}));
  ASSERT_TRUE(world.ends_path());
  EXPECT_EQ(world.phase(), GroundPhase::manual) << "it hovers at its end until the flight's";
  EXPECT_LT(world.away_m(1, 1), 0.15);
  world.say(path({at(30, 1)}));
  world.run(30);
  EXPECT_TRUE(world.core.done()) << "the flight's time lands it in the middle of a path";
  EXPECT_TRUE(world.core.ok()) << world.core.why();
}

}  // namespace
}  // namespace ledgerline::ground
