#include "onboard/link/core/pose/source_check.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

using Verdict = SourceCheck::Verdict;

/// A drone that flies as it says, watched by a motion capture that may be wrong. Poses come each 10 ms, texts each 100.
class Watched {
 public:
  void pass(double seconds, Eigen::Vector2d velocity) {
    for (int i = 0; i < static_cast<int>(std::lround(seconds * 100)); ++i) {
      now += 10 * ms;
      at += velocity * 0.01;
      frame += creeps * 0.01;
      late += (velocity - late) * std::min(1.0, 0.01 / lag_s);
      Pose pose;
      pose.stamp_ns = now;
      pose.position_m = {at.x() + frame.x(), at.y() + frame.y(), 1 + above};
      const Eigen::Vector2d moves = velocity + creeps;
      pose.velocity_mps = {moves.x(), moves.y(), 0};
      heading += turns * 0.01;
      pose.yaw_rad = heading + turned;
      if (posed && now % posed_every == 0 && check.accepts(pose, flies)) newest = pose, ++accepted;
      if (now % (100 * ms) != 0) continue;
      own.velocity_mps = late * scale + wrong;
      own.height_m = 1;
      own.heading_rad = heading;
      if (!repeats) own.barometer_m += 0.01F;
      check.on_state(now, own, newest, flies);
    }
  }

  SourceCheck check{300 * ms};
  OwnMotion own{.usable = true, .sigma_m = 0.1};
  TimeNs now = ns_per_s, posed_every = 10 * ms;
  Eigen::Vector2d at{0, 0}, frame{0, 0}, creeps{0, 0}, late{0, 0}, wrong{0, 0};
  double scale = 1, lag_s = 0.01, above = 0, heading = 0, turns = 0, turned = 0;
  bool flies = true, posed = true, repeats = false;
  int accepted = 0;
  Pose newest;
};

void fly_corners(Watched& drone, double speed, int corners) {
  for (int i = 0; i < corners; ++i) {
    const double angle = i * 1.5708;
    drone.pass(1.5, {speed * std::cos(angle), speed * std::sin(angle)});
  }
}

TEST(SourceCheck, AFrameThatCreepsIsSeenWithinTwoSeconds) {
  for (const auto& creep : {Eigen::Vector2d(0.2, 0), Eigen::Vector2d(0, 0.2), Eigen::Vector2d(-0.2, 0)}) {
    Watched drone;
    drone.pass(3, {0.5, 0});
    EXPECT_EQ(drone.check.verdict(), Verdict::agree);
    drone.creeps = creep;
    drone.pass(2, {0.5, 0});
    EXPECT_EQ(drone.check.verdict(), Verdict::differ);
    EXPECT_GT(drone.check.off_m(), 0.2);
    drone.pass(2, {0, 0});
    EXPECT_EQ(drone.check.verdict(), Verdict::unresolved);
  }
}

TEST(SourceCheck, WhatFliesAsItSaysAgreesWhateverItsScaleAndLag) {
  for (const double scale : {0.9, 1.0, 1.1}) {
    for (const double lag : {0.01, 0.1, 0.3}) {
      Watched drone;
      drone.scale = scale;
      drone.lag_s = lag;
      drone.own.lag_sigma_s = 0.2;
      fly_corners(drone, 1, 12);
      EXPECT_EQ(drone.check.verdict(), Verdict::agree) << scale << ' ' << lag;
      EXPECT_EQ(drone.check.off_m(), 0);
    }
  }
}

TEST(SourceCheck, AScaleThatNobodyMeasuredIsNoContradiction) {
  Watched drone;
  drone.scale = 0.75;
  drone.own.scale_sigma = 0.15;
  fly_corners(drone, 1, 8);
  EXPECT_EQ(drone.check.verdict(), Verdict::agree);
  drone.own.scale_sigma = 0.02;  // it was measured since
  drone.pass(3, {1.5, 0});
  EXPECT_NE(drone.check.verdict(), Verdict::agree);
}

TEST(SourceCheck, AGlitchThatIsOverAgreesAgain) {
  Watched drone;
  drone.pass(3, {0, 0});
  drone.frame = {0.29, 0};  // a marker slipped: no jump that no drone could fly
  drone.pass(0.5, {0, 0});
  EXPECT_EQ(drone.check.verdict(), Verdict::differ);
  drone.pass(1.8, {0, 0});
  EXPECT_EQ(drone.check.verdict(), Verdict::agree);
  EXPECT_GT(drone.check.off_m(), 0.25) << "which of the two places is right nobody can tell";
}

TEST(SourceCheck, AnotherBodyIsNoPose) {
  Watched drone;
  drone.pass(3, {0.5, 0});
  const int before = drone.accepted;
  drone.frame = {0, 1.1};
  drone.pass(2, {0.5, 0});
  EXPECT_EQ(drone.accepted, before);
  drone.frame = {0, 0};
  drone.pass(1, {0.5, 0});
  EXPECT_EQ(drone.accepted, before + 100);
  EXPECT_EQ(drone.check.verdict(), Verdict::agree);
  drone.above = -3;
  drone.pass(1, {0.5, 0});
  EXPECT_EQ(drone.accepted, before + 100) << "nor is one that is 3 m lower";
}

TEST(SourceCheck, AHeadingThatNobodyTurnsToIsNoPose) {
  Watched drone;
  drone.turns = 1.75;  // as fast as a Tello does
  drone.pass(3, {0.5, 0});
  EXPECT_EQ(drone.accepted, 300);
  drone.turns = 0;
  drone.pass(1, {0.5, 0});
  for (const double turned : {0.3, 2.1, -1.6}) {
    const int before = drone.accepted;
    drone.turned = turned;
    drone.pass(turned < 1 && turned > 0 ? 0.05 : 3, {0.5, 0});
    EXPECT_EQ(drone.accepted, before) << turned;
    drone.turned = 0;
    drone.pass(1, {0.5, 0});
    EXPECT_EQ(drone.accepted, before + 100) << turned;
  }
}

TEST(SourceCheck, WhatIsBackFromALongAbsenceIsTakenWhereItFits) {
  Watched drone;
  drone.pass(3, {0.5, 0});
  drone.posed = false;
  drone.pass(4, {0.5, 0});
  drone.posed = true;
  const int before = drone.accepted;
  drone.pass(0.1, {0.5, 0});
  EXPECT_EQ(drone.accepted, before + 10);
}

TEST(SourceCheck, OnTheGroundADroneMayBeCarriedAnywhere) {
  Watched drone;
  drone.pass(1, {0, 0});
  drone.flies = false;
  drone.pass(0.2, {0, 0});
  const int before = drone.accepted;
  drone.frame = {3, 0};
  drone.pass(1, {0, 0});
  EXPECT_EQ(drone.accepted, before + 100);
  drone.flies = true;
  drone.pass(3, {0, 0});
  EXPECT_EQ(drone.check.verdict(), Verdict::agree);
}

TEST(SourceCheck, WithoutAUsableVelocityThereIsNothingToCompare) {
  Watched drone;
  drone.pass(2, {0.5, 0});
  drone.own.usable = false;
  drone.creeps = {0.3, 0};
  drone.pass(5, {0.5, 0});
  EXPECT_EQ(drone.check.verdict(), Verdict::agree);
}

/// Motion capture of 2 Hz, where failsafe.pose_lost_ms allows it.
TEST(SourceCheck, ComparesEveryPoseThatIsNotLost) {
  for (const TimeNs pose_lost_ns : {300 * ms, 1000 * ms}) {
    Watched drone;
    drone.check = SourceCheck(pose_lost_ns);
    drone.posed_every = 500 * ms;
    drone.pass(3, {0.5, 0});
    EXPECT_EQ(drone.check.verdict(), Verdict::agree);
    drone.creeps = {0.3, 0};
    drone.pass(3, {0.5, 0});
    EXPECT_EQ(drone.check.verdict() == Verdict::agree, pose_lost_ns == 300 * ms);
  }
}

TEST(SourceCheck, AnUnresolvedOneIsTakenBackWhereItMovesAlikeAtOnePlace) {
  Watched drone;
  drone.pass(3, {0, 0});
  drone.creeps = {0.3, 0};
  drone.pass(5, {0, 0});
  ASSERT_EQ(drone.check.verdict(), Verdict::unresolved);
  drone.creeps = {0, 0};
  drone.pass(6, {0, 0});
  EXPECT_EQ(drone.check.verdict(), Verdict::unresolved) << "it is elsewhere";
  drone.own.position_m = drone.at + drone.frame;
  drone.pass(1, {0, 0});
  EXPECT_EQ(drone.check.verdict(), Verdict::agree);
  EXPECT_EQ(drone.check.off_m(), 0);
}

TEST(SourceCheck, ATextThatRepeatsItselfIsNoVelocity) {
  Watched drone;
  drone.pass(3, {0.5, 0});
  drone.repeats = true;
  drone.wrong = {0.5, 0};
  drone.pass(3, {0.5, 0});
  EXPECT_EQ(drone.check.verdict(), Verdict::agree);
}

TEST(SourceCheck, APushIsNoContradiction) {
  Watched drone;
  drone.pass(3, {0.5, 0});
  drone.pass(0.5, {0.5, 2.5});
  drone.pass(2, {0.5, 0});
  EXPECT_EQ(drone.check.verdict(), Verdict::agree);
}

TEST(SourceCheck, OneTornTextIsNoContradiction) {
  Watched drone;
  drone.pass(3, {0.3, 0});
  drone.wrong = {5, 0};
  drone.pass(0.1, {0.3, 0});
  drone.wrong = {0, 0};
  drone.pass(0.2, {0.3, 0});
  EXPECT_EQ(drone.check.verdict(), Verdict::agree);
}

}  // namespace
}  // namespace ledgerline::link
