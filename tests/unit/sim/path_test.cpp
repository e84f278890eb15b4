#include "sim/core/path.hpp"

#include <gtest/gtest.h>

#include <numbers>

namespace ledgerline::sim {
namespace {

TEST(SpeedProfile, CoversItsLengthAndStandsStillAtBothEnds) {
  for (const double length : {0.2, 1.0, 5.0}) {
    const SpeedProfile profile(length, 1.0, 1.5);
    EXPECT_NEAR(profile.at(0).speed, 0, 1e-9);
    EXPECT_NEAR(profile.at(profile.duration_s()).distance, length, 1e-9);
    double distance = 0;
    for (double t = 0; t < profile.duration_s(); t += 1e-4) {
      distance += profile.at(t).speed * 1e-4;
      EXPECT_LE(profile.at(t).speed, 1.0 + 1e-9);
      ASSERT_NEAR(profile.at(t).distance, distance, 1e-3);
    }
  }
}

TEST(SpeedProfile, FiveMetresAtFullSpeedEndBeforeDjitellopyAsksAgain) {
  EXPECT_LT(SpeedProfile(5.0, 1.0, 1.5).duration_s(), 6.0);  // 7 s less time to settle
}

TEST(Path, AnArcGoesThroughItsThreePointsInOrder) {
  const Vector start(1, 2, 3), via(1, 1, 0), end(2, 0, 0);
  const auto arc = Path::arc(start, via, end);
  ASSERT_TRUE(arc);
  EXPECT_NEAR(arc->radius(), 1.0, 1e-9);
  EXPECT_NEAR(arc->length(), std::numbers::pi, 1e-9);
  EXPECT_NEAR((arc->at(0).position - start).norm(), 0, 1e-9);
  EXPECT_NEAR((arc->at(arc->length() / 2).position - start - via).norm(), 0, 1e-9);
  EXPECT_NEAR((arc->at(arc->length()).position - start - end).norm(), 0, 1e-9);
}

TEST(Path, TheLongWayRoundIsTakenWhenViaLiesOnIt) {
  // Start (0,0), end (0.1, 0): via on the far side of a circle of radius 1.
  const auto arc = Path::arc(Vector::Zero(), Vector(0.05, 2, 0), Vector(0.1, 0, 0));
  ASSERT_TRUE(arc);
  EXPECT_GT(arc->length(), std::numbers::pi * arc->radius());
  EXPECT_NEAR((arc->at(arc->length()).position - Vector(0.1, 0, 0)).norm(), 0, 1e-9);
}

TEST(Path, PointsOnALineAreNoArc) { EXPECT_FALSE(Path::arc(Vector::Zero(), Vector(1, 0, 0), Vector(2, 0, 0))); }

}  // namespace
}  // namespace ledgerline::sim
