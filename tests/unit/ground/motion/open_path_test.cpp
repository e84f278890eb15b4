#include "ground/motion/waypoints.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "ground/motion/track.hpp"

namespace ledgerline::ground::motion {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

Waypoint at(double x, double y, double z = 1) { return {{x, y}, z}; }

Eigen::Vector3d place(const Track& track, double s_m) { return track.at(s_m).position_m; }

Track track_of(const OpenPath& course) { return {course.waypoints, course.origin_m, 1, TrackLimits{}}; }

TEST(OpenPath, ItsTrackBeginsWhereTheDroneIsAndEndsAtTheLastWaypointItself) {
  const std::vector<std::vector<Waypoint>> ways{
      {at(4, 2)},                         // one place to go to
      {at(4, 2), at(4, 5, 2), at(1, 5)},  // turns
      {at(4, 2), at(3, 2)},               // half the way back
      {at(4, 2), at(3, 2), at(2, 2)},     // the whole way back
      {at(4, 2), at(2, 4), at(2, 2)},     // around, to where it began
      {at(2.02, 2), at(2.02, 2.02)},      // hardly any way
      {at(2, 2), at(5, 2)},               // it is there already
  };
  for (std::size_t i = 0; i < ways.size(); ++i) {
    const OpenPath course = open_path(at(2, 2), ways[i]);
    const Track track = track_of(course);
    EXPECT_LT((place(track, 0) - Eigen::Vector3d(2, 2, 1)).norm(), 2e-3) << i;
    const double end_m = track.length_to(course.last);
    const Waypoint& last = ways[i].back();
    EXPECT_LT((place(track, end_m).head<2>() - last.at_m).norm(), 2e-3) << i;
    EXPECT_NEAR(place(track, end_m).z(), *last.height_m, 0.02) << i;
    for (std::size_t k = 0; k < ways[i].size(); ++k) {
      const Eigen::Vector2d near = place(track, track.length_to(course.first + k)).head<2>();
      // Half a knot beside it where it turns back: between knots it is straight.
      EXPECT_LT((near - ways[i][k].at_m).norm(), TrackLimits{}.cut_m + 5e-3) << i << ", waypoint " << k + 1;
    }
  }
}

TEST(OpenPath, LengthsToItsCornersGrow) {
  const OpenPath course = open_path(at(0, 0), {at(1, 0), at(1, 1), at(0, 1), at(0, 0.5)});
  const Track track = track_of(course);
  EXPECT_EQ(track.length_to(0), 0);
  for (std::size_t i = 1; i < course.waypoints.size(); ++i) EXPECT_GT(track.length_to(i), track.length_to(i - 1)) << i;
  EXPECT_LT(track.length_to(course.last), 3.5);
  EXPECT_GT(track.length_to(course.last), 3.2);
}

TEST(OpenPath, OneWaypointWhereTheDroneIsIsAPathOfNoLength) {
  const OpenPath course = open_path(at(2, 2, 0.8), {at(2.005, 2, 1.5)});
  EXPECT_EQ(course.last, 0U);
  const Track track = track_of(course);
  EXPECT_EQ(track.length_to(course.last), 0);
  EXPECT_LT((place(track, 0) - Eigen::Vector3d(2.005, 2, 1.5)).norm(), 1e-6);
}

TEST(OpenPath, TheFirstWaypointsSpeedHoldsOnTheWayToIt) {
  std::vector<Waypoint> way{at(2, 0), at(2, 3)};
  way[0].speed_mps = 0.2;
  const OpenPath course = open_path(at(0, 0), way);
  const Track track = track_of(course);
  EXPECT_LE(track.speed_at(1), 0.2);
  way = {at(2, 0)};
  EXPECT_GT(track_of(open_path(at(0, 0), way)).speed_at(1), 0.5);
}

std::string way_refused(const std::vector<Waypoint>& way) {
  const Status checked = check_way(way, {50, 0});
  return checked.ok() ? "taken" : checked.error().message;
}

TEST(Way, AWaypointThatCannotBeIsNamedWithWhatIsAllowed) {
  EXPECT_EQ(way_refused({at(50, 0)}), "taken") << "the drone is there already";
  EXPECT_EQ(way_refused({at(150, 0, 0.3), at(51, 0, 10)}), "taken");
  EXPECT_THAT(way_refused({}), HasSubstr("0 waypoints; 1 to 500 may be"));
  std::vector<Waypoint> many;
  for (int i = 0; i < 500; ++i) many.push_back(at(50 + 0.02 * i, 0));
  EXPECT_EQ(way_refused(many), "taken");
  many.push_back(at(0, 1));
  EXPECT_THAT(way_refused(many), StartsWith("501 waypoints"));
  EXPECT_THAT(way_refused({at(51, 0), at(150.5, 0)}), "waypoint 2 is 100.5 m away; 100 m may be");
  EXPECT_THAT(way_refused({at(std::numeric_limits<double>::quiet_NaN(), 0)}), StartsWith("waypoint 1 is nan m away"));
  EXPECT_THAT(way_refused({at(51, 0), at(52, 0, 0.2)}), "waypoint 2 has z 0.2 m; 0.3 to 10 may be");
  EXPECT_THAT(way_refused({at(51, 0, 11)}), StartsWith("waypoint 1 has z 11 m"));
  EXPECT_THAT(way_refused({at(51, 0, std::numeric_limits<double>::quiet_NaN())}), StartsWith("waypoint 1 has z nan"));
  Waypoint fast = at(51, 0);
  fast.speed_mps = 9;
  EXPECT_THAT(way_refused({fast}), "waypoint 1 has speed 9 m/s; 0.05 to 8 may be");
  fast.speed_mps = 0.01;
  EXPECT_THAT(way_refused({at(53, 0), fast}), StartsWith("waypoint 2 has speed 0.01"));
  EXPECT_THAT(way_refused({at(51, 0), at(52, 0), at(52.005, 0, 2)}),
              "waypoint 3 is closer than 1 cm to the one before");
}

}  // namespace
}  // namespace ledgerline::ground::motion
