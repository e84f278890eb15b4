#include "onboard/link/core/pose/motion_watch.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

class Moving {
 public:
  void fly(double seconds, std::array<float, 3> sent, std::array<double, 3> seen, std::array<double, 2> lean = {}) {
    for (int i = 0; i < static_cast<int>(seconds * 100); ++i) {
      watch.on_sent(0.01, sent);
      watch.set_lean(lean);
      watch.on_pose(now += 10 * ms, seen);
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

TEST(MotionWatch, OneThatOutrunsItsCommandsIsFoundAtOnce) {
  Moving drone;
  drone.fly(2, {1, 0, 0}, {1.7, 0, 0});
  EXPECT_EQ(drone.watch.outruns_since_ns(), 0);
  drone.fly(0.01, {1, 0, 0}, {1.9, 0, 0});
  EXPECT_EQ(drone.watch.outruns_since_ns(), drone.now);
}

TEST(MotionWatch, WhatNobodySawDoesNotCount) {
  Moving drone;
  drone.fly(3.9, {0.5F, 0, 0}, {-0.5, 0, 0});
  drone.now += 5 * ns_per_s;
  drone.fly(3.5, {0.5F, 0, 0}, {-0.5, 0, 0});
  EXPECT_FALSE(drone.found);
}

// A flight controller that leans by what its own estimate lacks, as the simulator's and PX4's do.
class Blown {
 public:
  explicit Blown(std::array<double, 2> wind_mps) : wind_mps_(wind_mps) {}
  /// `disobeys`: it flies so instead of what it is commanded.
  void fly(double seconds, std::array<float, 3> commanded, std::array<double, 2> disobeys = {9, 9}) {
    for (int i = 0; i < static_cast<int>(seconds * 100); ++i) {
      std::array<double, 2> lean{};
      for (std::size_t k = 0; k < 2; ++k) {
        const double wanted = disobeys[0] < 9 ? disobeys[k] : static_cast<double>(commanded[k]);
        lean[k] = (wanted - v_[k]) / 0.3 + 0.4 * v_[k];
        v_[k] += 0.01 * (lean[k] - 0.4 * (v_[k] - wind_mps_[k]));
      }
      watch.on_sent(0.01, commanded);
      watch.set_lean(lean);
      watch.on_pose(now += 10 * ms, {v_[0], v_[1], 0});
      found = found || watch.differs();
    }
  }
  /// A square, a leg of 3 s each.
  void fly_square(float mps) {
    for (int lap = 0; lap < 3; ++lap) {
      fly(3, {mps, 0, 0});
      fly(3, {0, mps, 0});
      fly(3, {-mps, 0, 0});
      fly(3, {0, -mps, 0});
    }
  }
  MotionWatch watch;
  TimeNs now = ns_per_s;
  bool found = false;

 private:
  std::array<double, 2> wind_mps_, v_{};
};

TEST(MotionWatch, ADroneThatIsOnlyBlownDoesAsItIsCommanded) {
  for (const double wind : {0.0, 2.0, 3.0, 4.0}) {
    for (const double from : {0.0, 0.7, 2.4, 4.0}) {
      Blown drone({wind * std::cos(from), wind * std::sin(from)});
      drone.fly(5, {0, 0, 0});
      drone.fly_square(0.5F);
      drone.fly(10, {0, 0, 0});
      EXPECT_FALSE(drone.found) << wind << " m/s from " << from;
    }
  }
}

TEST(MotionWatch, WindThatComesInFlightIsNoneEither) {
  Blown calm({0, 0}), windy({-4, 0});
  calm.fly(5, {0.5F, 0, 0});
  windy.watch = calm.watch;
  windy.now = calm.now;
  windy.fly(20, {0.5F, 0, 0});
  EXPECT_FALSE(windy.found);
}

TEST(MotionWatch, InWindOneThatDisobeysIsFoundAllTheSame) {
  for (const double wind : {-4.0, -3.0, 0.0, 3.0, 4.0}) {
    for (const auto& flies : {std::array{-0.5, 0.0}, std::array{0.0, 0.8}, std::array{-0.4, -0.4}}) {
      Blown drone({wind, 0});
      drone.fly(10, {0, 0, 0});
      drone.fly(6, {0.5F, 0, 0}, flies);
      EXPECT_TRUE(drone.found) << wind << " m/s, it flies " << flies[0] << ", " << flies[1];
    }
  }
}

TEST(MotionWatch, WhatIsLearnedAsDriftIsBounded) {
  Moving drone;
  drone.fly(4.5, {0, 0, 0}, {-1.5, 0, 0}, {5, 0});
  EXPECT_TRUE(drone.found) << "it is carried off, be it by wind";
}

/// Ten texts a second, of a drone whose flight controller trusts its flow.
class Flow {
 public:
  void fly(double seconds, double commanded_mps) {
    for (int i = 0; i < static_cast<int>(std::lround(seconds * 1000)); ++i) {
      flow_ = dark ? flow_ * std::exp(-0.001 / 0.5) : true_mps;
      const double wanted = holds ? -1.5 * flow_ - 0.12 * wind_mps : commanded_mps;
      const double lean = (wanted - flow_) / 0.3 + 0.4 * flow_;
      true_mps += 0.001 * (lean - 0.4 * (true_mps - wind_mps));
      motion_.on_sent(0.001, {static_cast<float>(commanded_mps), 0, 0});
      motion_.set_lean({lean, 0});
      now += ms;
      if (!dark && now % (10 * ms) == 0) motion_.on_pose(now, {true_mps, 0, 0});
      if (now % (100 * ms) != 0) continue;
      TelloState state;
      state.velocity_dmps[0] = static_cast<float>(std::round(reports * flow_ * 10));
      watch.update(now, state,
                   {.expected = motion_.expected(), .sent_mps = {commanded_mps, 0}, .lean_mps2 = {lean, 0}});
      if (watch.is_dark() && !blind_ns) blind_ns = now;
    }
  }
  bool dark = false;
  bool holds = false;  ///< by itself, against the wind: nobody commands it
  double reports = 1, wind_mps = 0, true_mps = 0;
  FlowWatch watch;
  TimeNs now = ns_per_s, blind_ns = 0;

 private:
  MotionWatch motion_;
  double flow_ = 0;
};

TEST(FlowWatch, AVelocityThatFadesWhileItLeansIsSuspectedBeforeItIsHalf) {
  for (const double mps : {0.4, 0.5, 1.0}) {
    Flow drone;
    drone.fly(5, mps);
    ASSERT_FALSE(drone.watch.is_dark());
    drone.dark = true;
    const TimeNs dark_ns = drone.now;
    drone.fly(2, mps);
    ASSERT_TRUE(drone.watch.is_dark()) << mps;
    EXPECT_LE(drone.blind_ns - dark_ns, 500 * ms) << mps;
  }
}

TEST(FlowWatch, OneThatStartsInTheDarkIsSuspectedWithinFiveTexts) {
  for (const double mps : {0.2, 0.5, 1.0}) {
    Flow drone;
    drone.dark = true;
    drone.fly(3, 0);
    EXPECT_FALSE(drone.watch.is_dark()) << "one that hovers looks the same either way";
    const TimeNs start_ns = drone.now;
    drone.fly(2, mps);
    ASSERT_TRUE(drone.watch.is_dark()) << mps;
    EXPECT_LE(drone.blind_ns - start_ns, 500 * ms) << mps;
  }
}

TEST(FlowWatch, OneThatSeesIsNotSuspectedHoweverItIsFlown) {
  for (const double reports : {0.7, 1.0, 1.3}) {
    Flow drone;
    drone.reports = reports;
    for (const double mps : {0.3, -0.3, 0.5, 0.0, 1.0, -1.0, 0.26, 1.0, 0.16, 0.0}) drone.fly(3, mps);
    EXPECT_FALSE(drone.watch.is_dark()) << reports;
  }
}

// Over a radio that naps its stick, attitude and text are late by half a second together.
TEST(FlowWatch, ALongLeanOfOneThatReportsWhatItShouldIsNotSuspected) {
  for (const float reported_dmps : {3.0F, 6.0F}) {
    FlowWatch watch;
    TimeNs now = ns_per_s;
    TelloState state;
    state.velocity_dmps[0] = reported_dmps;
    for (int i = 0; i < 5; ++i) {
      watch.update(now += between_texts_ns, state,
                   {.expected = {.response_mps = {0.55, 0}}, .sent_mps = {0.7, 0}, .lean_mps2 = {1.6, 0}});
    }
    EXPECT_EQ(watch.is_dark(), reported_dmps < 5) << reported_dmps;
  }
}

TEST(FlowWatch, OneThatIsBlownFromTheStartIsNotSuspected) {
  for (const double wind : {-3.0, 3.0}) {
    Flow drone;
    drone.wind_mps = wind;
    drone.fly(5, 0);
    drone.fly(5, 0.5);
    EXPECT_FALSE(drone.watch.is_dark()) << wind;
  }
}

// It leans at rest, and is drifted only once the stick is out.
TEST(FlowWatch, OneThatHeldItsPositionAgainstTheWindIsNotSuspected) {
  for (const double wind : {-3.0, 3.0}) {
    Flow drone;
    drone.wind_mps = wind;
    drone.fly(1, 0);
    drone.holds = true;
    drone.fly(5, 0);
    EXPECT_NEAR(drone.true_mps, 0, 0.02);
    drone.holds = false;
    drone.fly(5, 0.5);
    EXPECT_FALSE(drone.watch.is_dark()) << wind;
  }
}

TEST(FlowWatch, AGustThatStopsItIsSuspectedUntilItIsSeenToMove) {
  Flow drone;
  drone.fly(5, 0.5);
  drone.wind_mps = -4;
  drone.fly(0.7, 0.5);
  ASSERT_TRUE(drone.watch.is_dark());
  drone.fly(0.5, 0);  // as the failsafe brakes
  EXPECT_FALSE(drone.watch.is_dark());
}

TEST(FlowWatch, InTheDarkABrakeDoesNotEndTheSuspicionAndLightDoes) {
  Flow drone;
  drone.fly(5, 0.5);
  drone.dark = true;
  drone.fly(0.6, 0.5);
  ASSERT_TRUE(drone.watch.is_dark());
  drone.fly(5, 0);
  EXPECT_TRUE(drone.watch.is_dark());
  drone.dark = false;
  drone.true_mps = 0.3;
  drone.fly(0.1, 0);
  EXPECT_FALSE(drone.watch.is_dark());
}

// Whatever the lean says: a firmware may tell none.
TEST(FlowWatch, ZerosWhileItIsToMoveAreNoVelocity) {
  FlowWatch watch;
  TimeNs now = ns_per_s;
  const auto fly = [&](int texts, double expected_mps) {
    for (int i = 0; i < texts; ++i)
      watch.update(now += between_texts_ns, {}, {.expected = {{expected_mps, 0}, {}}, .sent_mps = {expected_mps, 0}});
    return watch.is_dark();
  };
  EXPECT_FALSE(fly(100, 0.05)) << "it hovers";
  EXPECT_FALSE(fly(9, 0.2));
  EXPECT_TRUE(fly(1, 0.2));
  EXPECT_TRUE(fly(50, 0)) << "braked, it sees no more than before";
}

}  // namespace
}  // namespace ledgerline::link
