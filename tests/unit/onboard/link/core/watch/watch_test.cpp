#include <gtest/gtest.h>

#include <cmath>

#include "common/base/random.hpp"
#include "onboard/link/core/watch/battery_watch.hpp"
#include "onboard/link/core/watch/flow_watch.hpp"
#include "onboard/link/core/watch/motion_watch.hpp"
#include "onboard/link/core/watch/tilt_watch.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs between_texts_ns = 100 * ms;

TelloState lying(float roll_deg) {
  TelloState state;
  state.attitude_deg[0] = roll_deg;
  const float roll = roll_deg * 3.14159265F / 180;
  state.acceleration_mg = {0, 1000 * std::sin(roll), -1000 * std::cos(roll)};
  return state;
}

TEST(TiltWatch, ThreeTextsBeyondTheLimitAreATiltAndOneIsAKnock) {
  TiltWatch watch;
  TimeNs now = ns_per_s;
  watch.take(now, lying(80));
  EXPECT_FALSE(watch.tilted());
  watch.take(now += between_texts_ns, lying(0));
  for (int i = 0; i < 3; ++i) watch.take(now += between_texts_ns, lying(80));
  EXPECT_TRUE(watch.tilted());
  EXPECT_NEAR(watch.tilt_rad(), 80 * 3.14159265 / 180, 1e-5);
}

TEST(TiltWatch, OneThatLiesIsOverturnedAfterASecond) {
  for (const float roll : {80.0F, 90.0F, 180.0F, -120.0F}) {
    TiltWatch watch;
    TimeNs now = ns_per_s;
    for (int i = 0; i < 10; ++i) watch.take(now += between_texts_ns, lying(roll));
    EXPECT_FALSE(watch.overturned()) << roll;
    watch.take(now += between_texts_ns, lying(roll));
    EXPECT_TRUE(watch.overturned()) << roll;
  }
}

// Its accelerometer feels its thrust along its own up: whatever the attitude, whatever the thrust.
TEST(TiltWatch, AFlyingDroneIsNeverOverturnedHoweverItTilts) {
  Random random(7);
  TiltWatch watch;
  TimeNs now = ns_per_s;
  for (int i = 0; i < 10'000; ++i) {
    TelloState state;
    state.attitude_deg = {static_cast<float>(360 * random.uniform() - 180),
                          static_cast<float>(180 * random.uniform() - 90), 0};
    const double thrust_mg = 2000 * random.uniform();
    state.acceleration_mg = {static_cast<float>(100 * random.normal()), static_cast<float>(100 * random.normal()),
                             static_cast<float>(-thrust_mg)};
    watch.take(now += between_texts_ns, state);
    ASSERT_FALSE(watch.overturned()) << i;
  }
}

TEST(TiltWatch, WhatWasBeforeAGapOfTextsDoesNotCount) {
  TiltWatch watch;
  TimeNs now = ns_per_s;
  for (int i = 0; i < 9; ++i) watch.take(now += between_texts_ns, lying(180));
  watch.take(now += 2 * ns_per_s, lying(180));
  EXPECT_FALSE(watch.tilted());
  EXPECT_FALSE(watch.overturned());
}

class Moving {
 public:
  void fly(double seconds, std::array<float, 3> told, std::array<double, 3> seen) {
    for (int i = 0; i < static_cast<int>(seconds * 100); ++i) {
      watch.tell(0.01, told);
      watch.see(now += 10 * ms, seen);
      found = found || watch.differs();
    }
  }
  MotionWatch watch;
  TimeNs now = ns_per_s;
  bool found = false;
};

TEST(MotionWatch, ADroneThatFliesTheOtherWayIsFound) {
  for (const auto& seen : {std::array{-0.5, 0.0, 0.0}, std::array{0.0, 0.5, 0.0}}) {
    Moving drone;
    drone.fly(4.0, {0.5F, 0, 0}, seen);
    EXPECT_FALSE(drone.found);
    drone.fly(1.5, {0.5F, 0, 0}, seen);
    EXPECT_TRUE(drone.found);
  }
}

TEST(MotionWatch, APushAndABrakeAreNone) {
  Moving drone;
  drone.fly(5, {1, 0, 0}, {0.8, 0.1, 0});
  drone.fly(1.5, {0, 0, 0}, {0.6, 0.0, 0});  // slow to stop
  drone.fly(5, {0, 0, 0}, {0.1, 0.1, 0});
  drone.fly(1, {0, 0, 0}, {-1.5, 1.0, 0});  // a push
  drone.fly(5, {0, 0, 0}, {0, 0, 0});
  EXPECT_FALSE(drone.found);
}

TEST(MotionWatch, WhatNobodySawDoesNotCount) {
  Moving drone;
  drone.fly(3.9, {0.5F, 0, 0}, {-0.5, 0, 0});
  drone.now += 5 * ns_per_s;
  drone.fly(3.5, {0.5F, 0, 0}, {-0.5, 0, 0});
  EXPECT_FALSE(drone.found);
}

TEST(BatteryWatch, WhatLandingNeedsGrowsWithTheRateAndTheHeight) {
  BatteryWatch watch;
  TimeNs now = ns_per_s;
  const auto fly = [&](double seconds, double per_s, double& charge) {
    for (int i = 0; i < static_cast<int>(seconds * 10); ++i) {
      charge -= per_s / 10;
      watch.take(now += between_texts_ns, static_cast<float>(std::round(charge * 100) / 100));
    }
  };
  double charge = 1;
  fly(60, 1 / 780.0, charge);
  EXPECT_LT(watch.needed(3), 0.08) << "an ordinary flight's";
  fly(10, 0.02, charge);
  EXPECT_NEAR(watch.rate_per_s(), 0.02, 0.005);
  EXPECT_NEAR(watch.needed(3), BatteryWatch::reserve + 0.02 * 8, 0.04);
  EXPECT_GT(watch.needed(3), watch.needed(1));
}

TEST(BatteryWatch, AFallIsNoticedWithinSeconds) {
  BatteryWatch watch;
  TimeNs now = ns_per_s;
  for (int i = 0; i < 30; ++i) watch.take(now += between_texts_ns, static_cast<float>(100 - i / 3) / 100);
  EXPECT_GT(watch.rate_per_s(), 0.02);
}

TEST(BatteryWatch, AChangedBatteryBeginsAnew) {
  BatteryWatch watch;
  watch.take(ns_per_s, 0.2F);
  watch.take(2 * ns_per_s, 1.0F);
  EXPECT_EQ(watch.needed(3), 0);
}

TEST(FlowWatch, ZerosWhileItIsToldToMoveAreNoVelocityUntilOneComesThatIsNotZero) {
  FlowWatch watch;
  TimeNs now = ns_per_s;
  const auto fly = [&](int texts, float told_dmps, double expected_mps) {
    TelloState state;
    state.velocity_dmps = {told_dmps, 0, 0};
    for (int i = 0; i < texts; ++i) watch.take(now += between_texts_ns, state, expected_mps);
    return watch.blind();
  };
  EXPECT_FALSE(fly(100, 0, 0.05)) << "it hovers";
  EXPECT_FALSE(fly(9, 0, 0.3));
  EXPECT_TRUE(fly(1, 0, 0.3));
  EXPECT_TRUE(fly(50, 0, 0)) << "braked, it sees no more than before";
  EXPECT_FALSE(fly(1, -1, 0));
}

}  // namespace
}  // namespace ledgerline::link
