#include "ground/motion/track.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace ledgerline::ground::motion {
namespace {

constexpr double a = TrackLimits{}.acceleration_mps2;
const double radius_m = TrackLimits{}.cut_m / (std::sqrt(2.0) - 1);  // of a corner of 90 degrees

Track track_of(Shape shape, double side_m, double full_scale_mps = 3) {
  TrackLimits limits;
  limits.full_scale_mps = full_scale_mps;
  return {waypoints_of(shape, side_m), {0.5, -0.25}, 1.0, limits};
}

TEST(Track, RoundsItsCornersAndIsShorterForIt) {
  const Track square = track_of(Shape::square, 2);
  // Each corner became a quarter of a circle.
  EXPECT_NEAR(square.length_m(), 8 - 4 * radius_m * (2 - std::numbers::pi / 2), 1e-9);
  // It begins in the middle of its first bend, the place that is nearest to the corner.
  EXPECT_NEAR((square.at(0).position_m.head<2>() - Eigen::Vector2d(0.5, -0.25)).norm(), TrackLimits{}.cut_m, 1e-3);
}

TEST(Track, StaysNearItsPolygonWithEveryShape) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x, Shape::eight}) {
    const Track track = track_of(shape, 1.5);
    const auto corners = waypoints_of(shape, 1.5);
    for (double s = 0; s < track.length_m(); s += 0.013) {
      const Eigen::Vector2d p = track.at(s).position_m.head<2>() - Eigen::Vector2d(0.5, -0.25);
      double nearest = 1e9;
      for (std::size_t i = 0; i < corners.size(); ++i) {
        const Eigen::Vector2d from = corners[i].at_m, piece = corners[(i + 1) % corners.size()].at_m - from;
        const double along = std::clamp((p - from).dot(piece) / piece.squaredNorm(), 0.0, 1.0);
        nearest = std::min(nearest, (p - from - along * piece).norm());
      }
      EXPECT_LT(nearest, TrackLimits{}.cut_m + 1e-4) << name_of(shape) << " at " << s;
    }
  }
}

TEST(Track, IsContinuousAroundItsLapAndLapsRepeat) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x, Shape::eight}) {
    const Track track = track_of(shape, 1.5);
    for (double s = 0; s < track.length_m(); s += 0.005) {
      const auto here = track.at(s), there = track.at(s + 0.005);
      EXPECT_NEAR((there.position_m - here.position_m).norm(), 0.005, 0.0005) << name_of(shape) << " at " << s;
      EXPECT_LT((track.at(s + 2 * track.length_m()).position_m - here.position_m).norm(), 1e-6);
    }
  }
}

// Differences over 2 cm: the direction itself is smoothed over one knot of 1 cm.
TEST(Track, NeverAsksForMoreAccelerationThanAllowed) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x, Shape::eight}) {
    const Track track = track_of(shape, 3);
    double most = 0;
    for (double s = 0; s < track.length_m(); s += 0.01) {
      const auto place = track.at(s);
      const double speed = place.speed_mps;
      const Eigen::Vector2d acceleration =
          place.gain_mps2 * place.direction.head<2>() + speed * speed * place.bend_per_m;
      most = std::max(most, acceleration.norm());
    }
    EXPECT_LT(most, 1.1 * a) << name_of(shape);
    EXPECT_GT(most, 0.9 * a) << name_of(shape);  // nor leaves much unused
  }
}

TEST(Track, ReachesTheSpeedThatItsSidesAllowAndSlowsForItsCorners) {
  const Track square = track_of(Shape::square, 4, 10);
  const double corner = std::sqrt(a * radius_m);
  double fastest = 0, slowest = 1e9;
  for (double s = 0; s < square.length_m(); s += 0.01) {
    fastest = std::max(fastest, square.speed_at(s));
    slowest = std::min(slowest, square.speed_at(s));
  }
  EXPECT_NEAR(slowest, corner, 0.02);
  // Half of a side, without its bends, to gain speed, half to lose it.
  EXPECT_NEAR(fastest, std::sqrt(corner * corner + a * (4 - 2 * radius_m)), 0.05);
}

TEST(Track, GainsSpeedNoFasterThanACommandedVelocityCanLead) {
  const Track square = track_of(Shape::square, 6, 1.0);
  for (double s = 0; s < square.length_m(); s += 0.01) {
    const auto place = square.at(s);
    EXPECT_LE(place.speed_mps + TrackLimits{}.lag_s * place.gain_mps2, 1.05) << s;
  }
}

TEST(Track, HeightGoesFromPointToPointAndNoFasterThanAllowed) {
  const auto points = waypoints_from_csv("0,0,1\n2,0,2\n2,2,2\n0,2\n", "f");
  ASSERT_TRUE(points.ok());
  const Track track(*points, {0, 0}, 1.0, {});
  double highest = 0, fastest_climb = 0;
  for (double s = 0; s < track.length_m(); s += 0.01) {
    const auto place = track.at(s);
    highest = std::max(highest, place.position_m.z());
    fastest_climb = std::max(fastest_climb, std::abs(place.direction.z()) * place.speed_mps);
  }
  EXPECT_NEAR(highest, 2, 1e-9);
  EXPECT_NEAR(track.at(0).position_m.z(), 1, 1e-9);
  EXPECT_LE(fastest_climb, TrackLimits{}.vertical_mps + 1e-9);
}

TEST(Track, AWaypointsSpeedHoldsUntilTheNext) {
  const auto points = waypoints_from_csv("0,0,,0.2\n3,0\n3,3\n0,3\n", "f");
  ASSERT_TRUE(points.ok());
  const Track track(*points, {0, 0}, 1.0, {});
  EXPECT_LE(track.speed_at(1.5), 0.2 + 1e-9);
  EXPECT_GT(track.speed_at(4.5), 0.8);
}

TEST(Track, TurningBackOnItselfIsSlowButNotTheEnd) {
  const auto points = waypoints_from_csv("0,0\n1,0\n2,0\n", "f");
  ASSERT_TRUE(points.ok());
  const Track track(*points, {0, 0}, 1.0, {});
  EXPECT_LT(track.lap_s(1.0), 20);
  // One of its two turns is at its beginning, the other half a lap later. A bend of a few millimetres lies between two
  // knots or on one: the knot before it is as slow as it.
  for (const double turn_m : {0.0, track.length_m() / 2}) {
    double slowest = 1e9;
    for (double s = turn_m - 0.03; s <= turn_m + 0.03; s += 0.001) slowest = std::min(slowest, track.speed_at(s));
    EXPECT_LT(slowest, 0.08) << turn_m;
  }
  EXPECT_GT(track.speed_at(track.length_m() / 4), 0.8);
  for (double s = 0; s < track.length_m(); s += 0.01) EXPECT_TRUE(track.at(s).position_m.allFinite());
}

}  // namespace
}  // namespace ledgerline::ground::motion
