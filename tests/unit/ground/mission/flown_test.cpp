#include <gtest/gtest.h>

#include <cmath>

#include "ground/mission/run.hpp"
#include "tests/unit/ground/core/flight_world.hpp"
#include "tests/unit/ground/mission/missions.hpp"

/// MissionRun over FlightCore itself, whose drones take off, fly and land.
namespace ledgerline::ground::mission {
namespace {

/// tello1 stands at (0, 1), tello2 at (3, 1).
Mission side_by_side() {
  return {
      "flown",
      {flown_by("tello1", {at(0, 3), at(1, 4), at(0, 5)}), flown_by("tello2", {at(3, 3), at(4, 4), at(3, 5)}, true)}};
}

FlightConfig flown_config() {
  FlightConfig config = config_for(2);
  config.manual = true;
  return config;
}

struct Conducted : FlightWorld {
  explicit Conducted(MissionRun run_) : FlightWorld(flown_config()), mission(std::move(run_)) {
    mission.set_approvals(std::vector<Approval>{{operator_name, mission.digest()}});
  }
  std::vector<DroneNow> seen() const { return {drone_now(core, 0), drone_now(core, 1)}; }
  /// Until it is in that phase; false: it is not within two minutes.
  bool conducts_to(RunPhase phase) {
    for (int i = 0; i < 1'200; ++i) {
      if (mission.phase() == phase) return true;
      conduct();
    }
    return false;
  }
  void conduct() {
    run(0.1);
    for (PilotCommand& command : mission.step(now_ns, seen()).commands) say(std::move(command));
    if (mission.awaits_check()) mission.resume_after_check(done);
    if (mission.phase() == RunPhase::to_start && began_ns == 0) began_ns = now_ns;
  }
  double away_m(std::size_t drone, double x, double y) const {
    const Eigen::Vector3d& place = drones[drone].model.motion.position_m;
    return std::hypot(place.x() - x, place.y() - y);
  }

  MissionRun mission;
  TimeNs began_ns = 0;
};

TEST(MissionFlown, FromTheGroundToBothEndsAsItsTimetableSays) {
  Conducted world(*MissionRun::make(side_by_side(), {}));
  world.run(1);
  const auto before = world.seen();
  EXPECT_TRUE(before[0].seen && before[0].on_ground && before[0].at_m);
  ASSERT_TRUE(world.mission.start({}));
  ASSERT_TRUE(world.conducts_to(RunPhase::to_start));
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::path) << "both in the same step";
  EXPECT_EQ(world.core.status(1).phase, GroundPhase::path);
  ASSERT_TRUE(world.conducts_to(RunPhase::flying));
  while (world.core.status(0).phase == GroundPhase::path && world.mission.active()) world.conduct();
  const double took_s = to_seconds(world.now_ns - world.began_ns);
  const Timetable table = timetable_of(at(0, 1), world.mission.mission().drones[0], flown_config().controller, 780);
  EXPECT_NEAR(took_s, table.end_s(), Apart{}.late_s) << "as late as check() allows for";
  ASSERT_TRUE(world.conducts_to(RunPhase::done));
  EXPECT_LT(world.away_m(0, 0, 5), 0.25);
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
  EXPECT_LT(world.away_m(1, 3, 5), 0.3);
  EXPECT_EQ(world.core.status(1).phase, GroundPhase::landed);
  EXPECT_TRUE(world.notes.empty()) << world.notes.front();
}

TEST(MissionFlown, PausedAndResumed) {
  Conducted world(*MissionRun::make(side_by_side(), {}));
  world.run(1);
  ASSERT_TRUE(world.mission.start({}));
  ASSERT_TRUE(world.conducts_to(RunPhase::flying));
  ASSERT_TRUE(world.mission.pause());
  for (int i = 0; i < 30; ++i) world.conduct();
  EXPECT_EQ(world.core.status(0).phase, GroundPhase::manual);
  EXPECT_EQ(world.core.status(1).phase, GroundPhase::manual);
  EXPECT_GE(world.mission.reached(0), 1U);
  EXPECT_LT(world.mission.reached(0), 3U);
  ASSERT_TRUE(world.mission.resume());
  ASSERT_TRUE(world.conducts_to(RunPhase::done));
  EXPECT_EQ(world.mission.reached(0), 3U);
  EXPECT_LT(world.away_m(0, 0, 5), 0.25);
}

TEST(MissionFlown, AGroundThatIsStartedAgainGoesOnWithTheRest) {
  const RunConfig rule{.after_restart = AfterRestart::go_on};
  Conducted killed(*MissionRun::make(side_by_side(), rule));
  killed.run(1);
  ASSERT_TRUE(killed.mission.start({}));
  ASSERT_TRUE(killed.conducts_to(RunPhase::flying));
  for (int i = 0; i < 10; ++i) killed.conduct();
  auto restored = MissionRun::restore(killed.mission.saved(), rule);
  ASSERT_TRUE(restored) << restored.error().message;

  Conducted again(std::move(*restored));
  again.drones = killed.drones;
  again.now_ns = killed.now_ns;
  ASSERT_TRUE(again.conducts_to(RunPhase::done)) << name_of(again.mission.phase()) << " " << again.mission.why();
  EXPECT_LT(again.away_m(0, 0, 5), 0.25);
  EXPECT_LT(again.away_m(1, 3, 5), 0.3);
  EXPECT_EQ(again.core.status(1).phase, GroundPhase::landed);
}

TEST(MissionFlown, ADroneThatIsStoppedHasTheOtherHover) {
  Conducted world(*MissionRun::make(side_by_side(), {}));
  world.run(1);
  ASSERT_TRUE(world.mission.start({}));
  ASSERT_TRUE(world.conducts_to(RunPhase::to_start));
  world.say({.drone = 0, .stop = true});
  for (int i = 0; i < 20; ++i) world.conduct();
  EXPECT_TRUE(world.mission.paused());
  EXPECT_TRUE(world.core.status(1).paused);
  ASSERT_TRUE(world.mission.end("enough"));
  for (int i = 0; i < 50; ++i) world.conduct();
  EXPECT_EQ(world.core.status(1).phase, GroundPhase::landed);
}

}  // namespace
}  // namespace ledgerline::ground::mission
