#include "ground/mission/corridor.hpp"

#include <gtest/gtest.h>

#include "ground/motion/waypoints.hpp"
#include "tests/unit/ground/mission/missions.hpp"

namespace ledgerline::ground::mission {
namespace {

ControllerConfig flight(double speed_mps = 0.5) {
  ControllerConfig config;
  config.speed_mps = speed_mps;
  return config;
}

Timetable timetable(std::vector<Waypoint> way, const ControllerConfig& config = flight(), double max_s = 780) {
  return timetable_of(at(0, 0), flown_by("tello1", std::move(way)), config, max_s);
}

TEST(Timetable, AStraightWayTakesItsLengthOverItsSpeed) {
  const Timetable table = timetable({at(10, 0)});
  EXPECT_NEAR(table.end_s(), 20, 1);
  EXPECT_TRUE(table.complete);
  EXPECT_LT((table.moments.front().at_m - Eigen::Vector3d(0, 0, 1)).norm(), 0.01);
  EXPECT_LT((table.moments.back().at_m - Eigen::Vector3d(10, 0, 1)).norm(), 0.01);
  EXPECT_NEAR(timetable({at(10, 0, 1, 0.25)}).end_s(), 40, 1) << "the waypoint's own speed, on the way to it";
  EXPECT_NEAR(timetable({at(10, 0, 1, 2)}).end_s(), 20, 1) << "none exceeds the flight's";
}

// PathController moves its reference by the same speeds.
TEST(Timetable, ItsEndIsWhereAControllersReferenceEnds) {
  const std::vector<Waypoint> way{at(2, 0), at(2, 2, 2, 0.3), at(0, 2), at(2, 2), at(1, 1, 0.5)};
  for (const double speed_mps : {0.3, 0.5, 1.0}) {
    const ControllerConfig config = flight(speed_mps);
    const Timetable table = timetable(way, config);
    const motion::OpenPath course = motion::open_path(at(0, 0), way);
    PathController controller(course.waypoints, course.origin_m, config, 0);
    StateSample state;
    TimeNs now = ns_per_s;
    const auto observe = [&](const Eigen::Vector3d& where) {
      state.stamp_ns = state.pose_stamp_ns = now;
      for (int axis = 0; axis < 3; ++axis) state.position_m[static_cast<std::size_t>(axis)] = where[axis];
      controller.observe(state);
    };
    const motion::Track track(course.waypoints, course.origin_m, config.height_m, track_limits(config));
    observe({0, 0, 1});
    controller.start(now, controller.length_to(course.last));
    for (std::uint64_t id = 1; !controller.at_end() && now < 200 * ns_per_s; ++id) {
      now += 50 * ns_per_ms;
      observe(track.at(controller.progress_m()).position_m);  // a drone that is where it should be
      controller.plan(id, now);
    }
    EXPECT_NEAR(to_seconds(now - ns_per_s), table.end_s(), 0.02 * table.end_s() + 0.5) << speed_mps;
  }
}

TEST(Timetable, WaypointsAreReachedInTheirOrder) {
  const Timetable table = timetable({at(1, 0), at(1, 1), at(0, 1)});
  ASSERT_EQ(table.reached_s.size(), 3U);
  EXPECT_LT(table.reached_s[0], table.reached_s[1]);
  EXPECT_EQ(table.reached_s[2], table.end_s());
  EXPECT_EQ(table.waypoint_at(0), 0U);
  EXPECT_EQ(table.waypoint_at(table.reached_s[0] + 0.01), 1U);
  EXPECT_EQ(table.waypoint_at(table.end_s() + 10), 2U);
}

TEST(Timetable, MomentsAreOneStepApart) {
  const Timetable table = timetable({at(1, 0), at(0, 0.02), at(0, 3, 3), at(2, 3)}, flight(1));
  for (std::size_t i = 1; i < table.moments.size(); ++i) {
    EXPECT_GT(table.moments[i].t_s, table.moments[i - 1].t_s);
    EXPECT_LE(table.moments[i].t_s - table.moments[i - 1].t_s, Timetable::step_s + 1e-9);
    EXPECT_LE((table.moments[i].at_m - table.moments[i - 1].at_m).head<2>().norm(), 0.11);
  }
}

TEST(Timetable, AChangeOfHeightAloneTakesTheTimeOfTheClimb) {
  const Timetable table = timetable({at(0, 0, 3)});
  EXPECT_NEAR(table.end_s(), 5, 0.1) << "2 m at 0.4 m/s";
  EXPECT_EQ(table.reached_s.at(0), table.end_s());
}

TEST(Timetable, ATooLongOneIsCutOffAndSaysSo) {
  const Timetable table = timetable({at(40, 0), at(0, 0)}, flight(), 60);
  EXPECT_FALSE(table.complete);
  EXPECT_NEAR(table.end_s(), 60, 0.11);
}

}  // namespace
}  // namespace ledgerline::ground::mission
