#include "onboard/link/core/pose/odometry.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "common/base/random.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs text_ns = 100 * ms;
constexpr double text_s = 0.1;

/// Of a good drone that was measured.
OdometrySettings calibrated() {
  OdometrySettings settings;
  settings.flow_mps = 0.011;
  settings.flow_s = 5;
  settings.flow_scale = 0.02;
  settings.velocity_lag_sigma_s = 0.03;
  return settings;
}

/// A drone that tells a Tello's state of how it really moves, with the errors that the odometry is set for.
class Walker {
 public:
  explicit Walker(std::uint64_t seed, OdometrySettings settings = calibrated())
      : random(seed), settings(settings), odometry(settings) {
    position = {settings.start_m[0] + settings.start_sigma_m * random.normal(),
                settings.start_m[1] + settings.start_sigma_m * random.normal(), settings.start_m[2]};
    heading_error = settings.start_sigma_rad * random.normal();
    flow = {settings.flow_mps * random.normal(), settings.flow_mps * random.normal()};
    scale = settings.flow_scale * random.normal();
    tell(true);
  }

  void fly(double seconds, std::array<double, 3> velocity) {
    for (int i = 0; i < static_cast<int>(seconds / text_s + 0.5); ++i) {
      // It gathers speed over a second, as a drone does.
      for (std::size_t k = 0; k < 3; ++k) {
        const double before = moves[k];
        moves[k] += 0.3 * (velocity[k] - moves[k]) + (k < 2 ? 0.03 * random.normal() : 0);  // gusts
        position[k] += (before + moves[k]) / 2 * text_s;
      }
      const double keeps = std::exp(-text_s / settings.flow_s);
      for (double& f : flow) f = keeps * f + settings.flow_mps * std::sqrt(1 - keeps * keeps) * random.normal();
      yaw += yaw_rate * text_s;
      now += text_ns;
      tell(false);
    }
  }
  void stand(double seconds) {
    moves = {};
    for (int i = 0; i < static_cast<int>(seconds / text_s); ++i) now += text_ns, tell(true);
  }

  void tell(bool stands) {
    TelloState state;
    state.has_velocity = state.has_barometer = true;
    state.motor_s = motor_s;
    // Its frame at power on: the map's, turned back by where its nose really pointed.
    const double turn = -(settings.start_yaw_rad + heading_error);
    const double vx = (moves[0] + flow[0]) / (1 + scale), vy = (moves[1] + flow[1]) / (1 + scale);
    const std::array sent{std::cos(turn) * vx - std::sin(turn) * vy, std::sin(turn) * vx + std::cos(turn) * vy,
                          moves[2]};
    for (std::size_t k = 0; k < 3; ++k)
      state.velocity_dmps[k] = stands ? 0 : settings.velocity_signs[k] * static_cast<float>(std::lround(sent[k] * 10));
    state.attitude_deg[2] = static_cast<float>(std::lround(-yaw * 180 / std::numbers::pi));
    const double above = position[2] - below_m;
    state.tof_m = static_cast<float>(std::max(0.1, std::round((above + 0.01 * random.normal()) * 100) / 100));
    state.height_m = static_cast<float>(std::round((position[2] - settings.start_m[2]) * 10) / 10);
    state.barometer_m = static_cast<float>(140 + position[2] + 0.15 * random.normal());
    if (blind) state.tof_m = 65.53F;
    odometry.on_state(now, state, stands);
  }

  /// A fix there, with the true heading.
  Odometry::Fix fix_at(const std::array<double, 3>& place_m) const {
    return {.position_m = place_m,
            .sigma_m = 0.03,
            .yaw_rad = settings.start_yaw_rad + heading_error + yaw,
            .sigma_rad = 0.05};
  }
  double error(std::size_t axis) const { return odometry.pose().position_m[axis] - position[axis]; }
  double sigma(std::size_t axis) const { return std::sqrt(static_cast<double>(odometry.pose().variance[axis])); }

  Random random;
  OdometrySettings settings;
  Odometry odometry;
  TimeNs now = ns_per_s;
  std::array<double, 3> position{}, moves{};
  std::array<double, 2> flow{};
  double scale = 0, heading_error = 0, yaw = 0, yaw_rate = 0, below_m = 0;
  int motor_s = 0;
  bool blind = false;
};

void fly_square(Walker& drone, double side_m = 2, double speed = 0.5) {
  for (const auto& way : {std::array{1, 0}, std::array{0, 1}, std::array{-1, 0}, std::array{0, -1}})
    drone.fly(side_m / speed, {speed * way[0], speed * way[1], 0});
}

/// A text with a velocity.
TelloState sent(double tof_m, double height_m) {
  TelloState state;
  state.has_velocity = true;
  state.tof_m = static_cast<float>(tof_m);
  state.height_m = static_cast<float>(height_m);
  return state;
}

TEST(Odometry, WhereItStartsIsWhereTheConfigSaysAndStandingAddsNothing) {
  OdometrySettings settings = calibrated();
  settings.start_m = {1, 2, 0};
  settings.start_yaw_rad = 0.7;
  Walker drone(1, settings);
  drone.stand(60);
  EXPECT_NEAR(drone.odometry.pose().position_m[0], 1, 1e-9);
  EXPECT_NEAR(drone.odometry.pose().position_m[1], 2, 1e-9);
  EXPECT_NEAR(drone.odometry.pose().yaw_rad, 0.7, 1e-9);
  EXPECT_NEAR(drone.sigma(0), settings.start_sigma_m, 1e-6);
}

TEST(Odometry, TheVarianceThatIsReportedIsTheErrorThatIsMade) {
  double sum = 0;
  int samples = 0, inside = 0;
  for (int seed = 1; seed <= 60; ++seed) {
    Walker drone(static_cast<std::uint64_t>(seed));
    drone.stand(3);
    drone.fly(4, {0, 0, 0.3});
    for (int lap = 0; lap < 3; ++lap) fly_square(drone);
    for (const std::size_t axis : {0U, 1U}) {
      const double normalised = drone.error(axis) / drone.sigma(axis);
      sum += normalised * normalised;
      inside += std::abs(normalised) < 3 ? 1 : 0;
      ++samples;
    }
  }
  EXPECT_GT(sum / samples, 0.5);
  EXPECT_LT(sum / samples, 2.0);
  EXPECT_GE(inside, samples * 95 / 100);
}

TEST(Odometry, TheVarianceGrowsWithTimeInTheAir) {
  Walker drone(3);
  drone.fly(5, {0, 0, 0.2});
  const double soon = drone.sigma(0);
  drone.fly(60, {0, 0, 0});
  EXPECT_GT(drone.sigma(0), 1.5 * soon);
}

TEST(Odometry, VelocitiesAreReadInTheFrameAndWithTheSignsOfTheSettings) {
  OdometrySettings settings = calibrated();
  settings.start_yaw_rad = std::numbers::pi / 2;
  settings.velocity_signs = {-1, 1, -1};
  settings.start_sigma_rad = 1e-6;
  Walker drone(4, settings);
  drone.fly(5, {0, 0, 0.2});
  drone.fly(6, {0.5, 0.2, 0});
  EXPECT_NEAR(drone.error(0), 0, 0.3);
  EXPECT_NEAR(drone.error(1), 0, 0.3);
  EXPECT_NEAR(drone.odometry.pose().velocity_mps[0], 0.5, 0.1);
}

TEST(Odometry, ItsYawTurnsWithTheDronesOwn) {
  Walker drone(5);
  drone.fly(5, {0, 0, 0.2});
  drone.yaw_rate = 0.5;
  drone.fly(4, {0, 0, 0});
  EXPECT_NEAR(std::remainder(drone.odometry.pose().yaw_rad - 2.0, 2 * std::numbers::pi), 0, 0.02);
}

TEST(Odometry, TheHeightFollowsTofAndATableBelowIsNoClimb) {
  Walker drone(6);
  drone.fly(5, {0, 0, 0.2});
  drone.fly(5, {0.2, 0, 0});
  EXPECT_NEAR(drone.error(2), 0, 0.05);
  drone.below_m = 0.75;
  drone.fly(1, {0.2, 0, 0});
  EXPECT_NEAR(drone.error(2), 0, 0.12);
  drone.fly(10, {0, 0, 0});
  EXPECT_NEAR(drone.error(2), 0, 0.15);
  drone.below_m = 0;
  drone.fly(5, {0.2, 0, 0});
  EXPECT_NEAR(drone.error(2), 0, 0.15);
}

TEST(Odometry, WithoutASightOfTheGroundItsVelocityIsNotUsableAndThePoseGrowsOld) {
  Walker drone(7);
  drone.fly(5, {0, 0, 0.2});
  const TimeNs seen_ns = drone.odometry.pose().stamp_ns;
  EXPECT_EQ(seen_ns, drone.now);
  drone.blind = true;
  drone.fly(2, {0.2, 0, 0});
  EXPECT_EQ(drone.odometry.pose().stamp_ns, seen_ns);
}

TEST(Odometry, AFixBringsItBackWithoutAJump) {
  Walker drone(8);
  drone.fly(5, {0, 0, 0.2});
  drone.fly(120, {0, 0, 0});
  const auto before = drone.odometry.pose().position_m;
  const std::array fixed{before[0] + 0.5, before[1] - 0.3, before[2]};
  drone.odometry.fix(drone.fix_at(fixed));
  EXPECT_NEAR(drone.odometry.pose().position_m[0], before[0], 1e-9);
  EXPECT_GT(drone.sigma(0), 0.2) << "what is held back is uncertain";
  double last = before[0], largest = 0;
  for (int i = 0; i < 50; ++i) {
    drone.fly(text_s, {0, 0, 0});
    largest = std::max(largest, std::abs(drone.odometry.pose().position_m[0] - last));
    last = drone.odometry.pose().position_m[0];
  }
  EXPECT_NEAR(last, fixed[0], 0.15);
  EXPECT_LT(largest, 0.2 * text_s + 0.02);
}

TEST(Odometry, FixesNowAndThenHoldTheErrorDown) {
  for (int seed = 1; seed <= 10; ++seed) {
    Walker drone(static_cast<std::uint64_t>(seed));
    drone.fly(5, {0, 0, 0.2});
    for (int lap = 0; lap < 5; ++lap) {
      fly_square(drone);
      for (int i = 0; i < 5; ++i) {
        drone.odometry.fix(drone.fix_at({drone.position[0] + 0.02 * drone.random.normal(),
                                         drone.position[1] + 0.02 * drone.random.normal(), drone.position[2]}));
        drone.fly(text_s, {0, 0, 0});
      }
    }
    drone.fly(2, {0, 0, 0});
    EXPECT_LT(std::hypot(drone.error(0), drone.error(1)), 0.15) << seed;
  }
}

TEST(Odometry, FirstSeenInTheAirItIsAnywhere) {
  Odometry odometry({});
  odometry.on_state(ns_per_s, sent(1, 1), false);
  EXPECT_GT(odometry.pose().variance[0], 1000);
}

TEST(Odometry, SwitchedOffAndOnItStandsAtItsStartAgainAndAfterAnAbsenceAloneItDoesNot) {
  Walker drone(9);
  drone.motor_s = 40;
  drone.fly(5, {0.5, 0, 0.1});
  drone.stand(2);
  const double place = drone.odometry.pose().position_m[0];
  EXPECT_GT(place, 1);
  drone.now += 20 * ns_per_s;
  drone.stand(1);
  EXPECT_NEAR(drone.odometry.pose().position_m[0], place, 1e-6);
  drone.motor_s = 0;
  drone.stand(1);
  EXPECT_NEAR(drone.odometry.pose().position_m[0], 0, 1e-9);
}

TEST(Odometry, AGapOfTextsInTheAirIsUncertainty) {
  Walker drone(10);
  drone.fly(5, {0.5, 0, 0.2});
  const double before = drone.sigma(0);
  drone.now += 3 * ns_per_s;
  drone.fly(text_s, {0.5, 0, 0});
  EXPECT_GT(drone.sigma(0), before + 1);
}

TEST(Odometry, AnOldTextInTheAirIsNoNewDrone) {
  Walker drone(11);
  drone.motor_s = 40;
  drone.fly(5, {0.5, 0, 0.2});
  const auto before = drone.odometry.pose().position_m;
  drone.motor_s = 39;
  drone.fly(text_s, {0.5, 0, 0});
  EXPECT_NEAR(drone.odometry.pose().position_m[0], before[0], 0.1);
  EXPECT_LT(drone.sigma(0), 1);
}

TEST(Odometry, WhatLandedUnmeasuredMayBeAnywhereNear) {
  Walker drone(12);
  drone.fly(5, {0.5, 0, 0.2});
  drone.now += 4 * ns_per_s;
  drone.stand(1);
  EXPECT_GT(drone.sigma(0), 4);
}

TEST(Odometry, WhatIsFlownWithoutAUsableVelocityIsUncertain) {
  Walker drone(13);
  drone.fly(5, {0.3, 0, 0.2});
  drone.blind = true;
  drone.fly(3, {-0.5, 0.3, 0});
  drone.blind = false;
  drone.fly(text_s, {0, 0, 0});
  for (const std::size_t axis : {0U, 1U}) EXPECT_LT(std::abs(drone.error(axis)), 3 * drone.sigma(axis));
  EXPECT_GT(drone.sigma(0), 0.3);
}

TEST(Odometry, AFirstTextWithoutASightOfTheGroundIsMadeGoodByTheNext) {
  Odometry odometry({});
  TelloState state = sent(65.53, 0);
  state.motor_s = 3;
  odometry.on_state(ns_per_s, state, false);
  EXPECT_GT(odometry.pose().variance[0], 1000);
  state.tof_m = 0.1F;
  odometry.on_state(ns_per_s + text_ns, state, true);
  EXPECT_LT(odometry.pose().variance[0], 0.01);
}

TEST(Odometry, OneFixFarOffIsRefusedAndThreeInARowAreTrusted) {
  Walker drone(14);
  drone.fly(5, {0, 0, 0.2});
  const auto before = drone.odometry.pose().position_m;
  const auto far = drone.fix_at({before[0] + 5, before[1], before[2]});
  for (int i = 0; i < 2; ++i) {
    drone.odometry.fix(far);
    drone.fly(text_s, {0, 0, 0});
    EXPECT_LT(drone.sigma(0), 0.3) << i;
  }
  drone.odometry.fix(far);
  EXPECT_GT(drone.sigma(0), 1) << "what is held back is uncertain";
  drone.fly(30, {0, 0, 0});
  EXPECT_NEAR(drone.odometry.pose().position_m[0], before[0] + 5, 0.5);
}

TEST(Odometry, FixesFarOffThatDoNotAgreeAreNeverTrusted) {
  Walker drone(16);
  drone.fly(5, {0, 0, 0.2});
  const auto before = drone.odometry.pose().position_m;
  for (int i = 0; i < 12; ++i) {
    const double angle = i * 2.1;
    drone.odometry.fix(drone.fix_at({before[0] + 3 * std::cos(angle), before[1] + 3 * std::sin(angle), before[2]}));
    drone.fly(text_s, {0, 0, 0});
    EXPECT_LT(drone.sigma(0), 0.3) << i;
  }
  EXPECT_NEAR(drone.error(0), 0, 0.2);
}

TEST(Odometry, AHeadingFarOffIsRefusedForSecondsWhileItsPlaceCounts) {
  Walker drone(17);
  drone.fly(5, {0, 0, 0.2});
  const auto turned_fix = [&] {
    auto fix = drone.fix_at(drone.position);
    fix.yaw_rad += 1.5;
    return fix;
  };
  for (int i = 0; i < 30; ++i) {
    drone.odometry.fix(turned_fix());
    drone.fly(text_s, {0.3, 0, 0});
  }
  EXPECT_NEAR(std::remainder(drone.odometry.pose().yaw_rad - drone.fix_at({}).yaw_rad, 6.2832), 0, 0.15);
  EXPECT_LT(std::hypot(drone.error(0), drone.error(1)), 0.1);
  for (int i = 0; i < 30; ++i) {
    drone.odometry.fix(turned_fix());
    drone.fly(text_s, {0, 0, 0});
  }
  EXPECT_GT(std::abs(std::remainder(drone.odometry.pose().yaw_rad - drone.fix_at({}).yaw_rad, 6.2832)), 1)
      << "said for five seconds it is so";
}

TEST(Odometry, AfterHalfAMinuteOr15MWithoutAFixItIsOverdue) {
  Walker drone(18);
  drone.stand(60);
  EXPECT_FALSE(drone.odometry.is_overdue());
  drone.fly(29, {0, 0, 0});
  EXPECT_FALSE(drone.odometry.is_overdue());
  drone.fly(2, {0, 0, 0});
  EXPECT_TRUE(drone.odometry.is_overdue());
  drone.odometry.fix(drone.fix_at(drone.position));
  EXPECT_FALSE(drone.odometry.is_overdue());
  drone.fly(14, {1, 0, 0});
  EXPECT_FALSE(drone.odometry.is_overdue());
  drone.fly(3, {1, 0, 0});
  EXPECT_TRUE(drone.odometry.is_overdue());
}

TEST(Odometry, AVelocityThatMayBeLateIsInTheVarianceWhileItsSpeedIsAnother) {
  OdometrySettings settings = calibrated();
  settings.velocity_lag_sigma_s = 0.2;
  Walker drone(19, settings);
  drone.fly(5, {0, 0, 0.2});
  const double hovering = drone.sigma(0);
  drone.fly(2, {1, 0, 0});
  EXPECT_GT(drone.sigma(0), 0.19);
  drone.fly(3, {0, 0, 0});
  EXPECT_LT(drone.sigma(0), hovering + 0.1);
}

TEST(Odometry, AScaleACastAndALagThatAreKnownAreMadeGood) {
  OdometrySettings settings = calibrated();
  settings.velocity_scale = 1.25;
  settings.velocity_truncated = true;
  settings.velocity_lag_s = 0.2;
  Odometry odometry(settings);
  TelloState state = sent(0.1, 0);
  odometry.on_state(ns_per_s, state, true);
  state.tof_m = 1;
  // It gathers speed evenly, backwards: 1 m/s after 5 s.
  for (int i = 1; i <= 50; ++i) {
    const double late_mps = std::max(0.0, 0.2 * (i * text_s - 0.2));
    state.velocity_dmps[0] = -static_cast<float>(static_cast<int>(late_mps / 1.25 * 10));
    odometry.on_state(ns_per_s + i * text_ns, state, false);
  }
  EXPECT_NEAR(odometry.pose().position_m[0], -0.1 * 25, 0.06)
      << "0.5 m of them by scale, 0.3 by the cast, 0.2 by the lag";
}

TEST(Odometry, FirstSeenInTheAirItsHeadingComesWithAFix) {
  Walker drone(15);
  drone.odometry = Odometry({});
  drone.yaw = 1.2;
  drone.position[2] = 1;
  drone.tell(false);
  EXPECT_GT(drone.odometry.pose().variance[3], 1);
  drone.odometry.fix(drone.fix_at({1, 2, 1}));
  EXPECT_LT(drone.odometry.pose().variance[3], 0.01);
  EXPECT_NEAR(std::remainder(drone.odometry.pose().yaw_rad - (1.2 + drone.heading_error), 2 * std::numbers::pi), 0,
              0.05);
}

}  // namespace
}  // namespace ledgerline::link
