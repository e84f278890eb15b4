#include "onboard/link/core/drone_watches.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "common/base/random.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

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
  watch.update(now, lying(80));
  EXPECT_FALSE(watch.is_tilted());
  watch.update(now += between_texts_ns, lying(0));
  for (int i = 0; i < 3; ++i) watch.update(now += between_texts_ns, lying(80));
  EXPECT_TRUE(watch.is_tilted());
  EXPECT_NEAR(watch.tilt_rad(), 80 * 3.14159265 / 180, 1e-5);
}

TEST(TiltWatch, OneThatLiesIsOverturnedAfterASecond) {
  for (const float roll : {80.0F, 90.0F, 180.0F, -120.0F}) {
    TiltWatch watch;
    TimeNs now = ns_per_s;
    for (int i = 0; i < 10; ++i) watch.update(now += between_texts_ns, lying(roll));
    EXPECT_FALSE(watch.is_overturned()) << roll;
    watch.update(now += between_texts_ns, lying(roll));
    EXPECT_TRUE(watch.is_overturned()) << roll;
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
    watch.update(now += between_texts_ns, state);
    ASSERT_FALSE(watch.is_overturned()) << i;
  }
}

TEST(TiltWatch, WhatWasBeforeAGapOfTextsDoesNotCount) {
  TiltWatch watch;
  TimeNs now = ns_per_s;
  for (int i = 0; i < 9; ++i) watch.update(now += between_texts_ns, lying(180));
  watch.update(now += 2 * ns_per_s, lying(180));
  EXPECT_FALSE(watch.is_tilted());
  EXPECT_FALSE(watch.is_overturned());
}

TEST(BatteryWatch, WhatLandingNeedsGrowsWithTheRateAndTheHeight) {
  BatteryWatch watch;
  TimeNs now = ns_per_s;
  const auto fly = [&](double seconds, double per_s, double& charge) {
    for (int i = 0; i < static_cast<int>(seconds * 10); ++i) {
      charge -= per_s / 10;
      watch.update(now += between_texts_ns, static_cast<float>(std::round(charge * 100) / 100));
    }
  };
  double charge = 1;
  fly(60, 1 / 780.0, charge);
  EXPECT_LT(watch.needed(3), 0.08) << "an ordinary flight's";
  fly(10, 0.02, charge);
  EXPECT_NEAR(watch.needed(3), BatteryWatch::reserve + 0.02 * 8, 0.04);
  EXPECT_GT(watch.needed(3), watch.needed(1));
}

TEST(BatteryWatch, AFallIsNoticedWithinSeconds) {
  BatteryWatch watch;
  TimeNs now = ns_per_s;
  for (int i = 0; i < 30; ++i) watch.update(now += between_texts_ns, static_cast<float>(100 - i / 3) / 100);
  EXPECT_GT(watch.needed(3), BatteryWatch::reserve + 0.02 * 8);
}

TEST(BatteryWatch, AChangedBatteryStartsAgain) {
  BatteryWatch watch;
  watch.update(ns_per_s, 0.2F);
  watch.update(2 * ns_per_s, 1.0F);
  EXPECT_EQ(watch.needed(3), 0);
}

TEST(HeatWatch, OnTheGroundItIsHotEarlierThanInTheAirAndTheWarningDoesNotFlap) {
  HeatWatch watch;
  const auto hot = [&](float degrees, bool flies) {
    watch.update({.temperature_c = degrees}, flies);
    return watch.is_hot();
  };
  EXPECT_FALSE(hot(85, false));
  EXPECT_TRUE(hot(86, false));
  EXPECT_TRUE(hot(83, false));
  EXPECT_FALSE(hot(82, false));
  EXPECT_FALSE(hot(88, true)) << "what it says in every flight";
  EXPECT_TRUE(hot(91, true));
}

/// Two links that take turns, or a radio that comes and goes.
class Clients {
 public:
  void texts(double seconds) {
    for (int i = 0; i < static_cast<int>(std::lround(seconds * 10)); ++i) watch.on_text(now += between_texts_ns);
  }
  void away(TimeNs for_ns) { now += for_ns; }
  void command() { watch.on_command(now); }
  ClientWatch watch;
  TimeNs now = ns_per_s;
};

TEST(ClientWatch, TextsThatComeBackWithCommandTwiceWithinAMinuteAreContested) {
  Clients two;
  two.texts(5);
  for (int i = 0; i < 2; ++i) {
    EXPECT_FALSE(two.watch.is_contested(two.now)) << i;
    two.away(3 * ns_per_s);
    two.command();
    two.texts(5);
  }
  EXPECT_TRUE(two.watch.is_contested(two.now));
  two.texts(60);
  EXPECT_FALSE(two.watch.is_contested(two.now)) << "a minute of peace";
}

TEST(ClientWatch, ARadioThatComesBackByItselfAndOneNewBatteryAreNone) {
  Clients radio;
  radio.texts(5);
  for (int i = 0; i < 5; ++i) {
    radio.away(3 * ns_per_s);
    radio.command();  // not heard
    radio.away(ns_per_s);
    radio.texts(5);
  }
  EXPECT_FALSE(radio.watch.is_contested(radio.now));
  radio.away(20 * ns_per_s);
  radio.command();
  radio.texts(5);
  EXPECT_FALSE(radio.watch.is_contested(radio.now));
  EXPECT_FALSE(radio.watch.is_diverted(radio.now));
}

TEST(ClientWatch, OneThatAnswersAndWhoseTextsStayAwayIsDiverted) {
  Clients other;
  other.texts(5);
  other.away(3 * ns_per_s);
  EXPECT_FALSE(other.watch.is_diverted(other.now)) << "it may be off";
  other.watch.on_answer(other.now);
  EXPECT_FALSE(other.watch.is_diverted(other.now));
  other.away(ns_per_s);
  other.watch.on_answer(other.now);
  EXPECT_TRUE(other.watch.is_diverted(other.now));
  other.texts(1);
  EXPECT_FALSE(other.watch.is_diverted(other.now));
}

}  // namespace
}  // namespace ledgerline::link
