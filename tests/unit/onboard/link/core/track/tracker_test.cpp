#include "onboard/link/core/track/tracker.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace ledgerline::link {
namespace {

constexpr double step_s = 0.01;
constexpr TimeNs step_ns = 10 * ns_per_ms;

/// A drone as the model has it, in wind, with a pose 30 times a second, 20 ms late.
struct BlownDrone {
  explicit BlownDrone(const TrackSettings& settings = {}) : tracker(settings) { tracker.set_response(response); }

  /// Flies for a step what `velocity` says; then looks.
  void fly(const Velocity& velocity) {
    tracker.on_sent(now, velocity, true);
    const Eigen::Vector3d end =
        Eigen::Vector3d(velocity.mps[0], velocity.mps[1], velocity.mps[2]) * response.gain + wind_mps;
    velocity_mps += (end - velocity_mps) * step_s / response.lag_s;
    position_m += velocity_mps * step_s;
    now += step_ns;
    if (++steps % 3 != 0) return;
    tracker.on_pose(seen);
    seen.stamp_ns = now;
    Eigen::Vector3d::Map(seen.position_m.data()) = position_m;
    Eigen::Vector3d::Map(seen.velocity_mps.data()) = velocity_mps;
  }

  Response response{.gain = 1, .lag_s = 0.2, .dead_s = 0};
  Tracker tracker;
  TimeNs now = ns_per_s;
  int steps = 0;
  Pose seen{};  ///< comes with the next one
  Eigen::Vector3d position_m{0, 0, 1}, velocity_mps = Eigen::Vector3d::Zero(), wind_mps = Eigen::Vector3d::Zero();
};

Reference at(double x, double vx = 0) { return {{static_cast<float>(x), 0, 1}, {static_cast<float>(vx), 0, 0}, {}}; }

TEST(Tracker, ADroneThatIsToStayStaysInWind) {
  BlownDrone held, blown;
  held.wind_mps = blown.wind_mps = {0.2, -0.1, 0};
  double farthest_m = 0;
  for (int i = 0; i < 1000; ++i) {
    held.fly(held.tracker.hold(held.now));
    blown.fly({});
    farthest_m = std::max(farthest_m, held.position_m.head<2>().norm());
  }
  EXPECT_GT(blown.position_m.head<2>().norm(), 2);
  EXPECT_LT(farthest_m, 0.5) << "it stops first";
  EXPECT_LT(held.velocity_mps.norm(), 0.01);
}

TEST(Tracker, WhatBlowsIsCorrectedOnThePath) {
  BlownDrone tracked, planned;
  double worst_m = 0, worst_planned_m = 0;
  for (int i = 0; i < 1000; ++i) {
    const double t_s = i * step_s;
    tracked.wind_mps.y() = planned.wind_mps.y() = 0.1 * std::sin(2 * t_s);
    const Velocity plan{{0.5F, 0, 0}, 0};
    tracked.fly(tracked.tracker.follow(tracked.now, plan, at(0.5 * t_s, 0.5)));
    planned.fly(plan);
    if (i < 200) continue;
    worst_m = std::max(worst_m, std::abs(tracked.position_m.y()));
    worst_planned_m = std::max(worst_planned_m, std::abs(planned.position_m.y()));
  }
  EXPECT_LT(worst_m, 0.4 * worst_planned_m);
  EXPECT_NEAR(tracked.position_m.x(), 5, 0.05);
}

TEST(Tracker, OfWhatWasSignedItDiffersByItsLimitAtMost) {
  const TrackSettings settings;
  BlownDrone drone(settings);
  for (int i = 0; i < 30; ++i) drone.fly({});
  for (const float far_m : {-1000.0F, -1.0F, 1.0F, 1000.0F}) {
    const Velocity planned{{0.2F, 0.1F, 0}, 0.3F};
    const Reference reference{{far_m, -far_m, far_m}, {}, {}};
    const Velocity out = drone.tracker.follow(drone.now, planned, reference);
    EXPECT_LE(std::hypot(out.mps[0] - planned.mps[0], out.mps[1] - planned.mps[1]), settings.max_correction_mps + 1e-6);
    EXPECT_LE(std::abs(out.mps[2]), settings.max_correction_mps + 1e-6);
    EXPECT_EQ(out.yaw_radps, planned.yaw_radps);
  }
}

TEST(Tracker, AnUncertainPlaceIsCorrectedByLess) {
  const auto change = [](float variance_m2) {
    BlownDrone drone;
    drone.seen.variance = {variance_m2, variance_m2, 0, 0};
    for (int i = 0; i < 30; ++i) drone.fly({});
    return drone.tracker.follow(drone.now, {}, at(0.05)).mps[0];
  };
  EXPECT_NEAR(change(0.01F), change(0) / 2, 0.01);
  EXPECT_LT(change(1), 0.01 * 0.3);
}

TEST(Tracker, APlaceIsHeldUntilItIsLetGo) {
  BlownDrone drone;
  for (int i = 0; i < 300; ++i) drone.fly(drone.tracker.hold(drone.now));
  drone.position_m.x() = 0.2;  // pushed
  for (int i = 0; i < 600; ++i) drone.fly(drone.tracker.hold(drone.now));
  EXPECT_NEAR(drone.position_m.x(), 0, 0.02);
  drone.tracker.let_go();
  for (int i = 0; i < 200; ++i) drone.fly({{0.5F, 0, 0}, 0});
  const double there_m = drone.position_m.x();
  for (int i = 0; i < 600; ++i) drone.fly(drone.tracker.hold(drone.now));
  EXPECT_GT(drone.position_m.x(), there_m - 0.02);
  EXPECT_LT(drone.position_m.x(), there_m + 0.25) << "where it came to rest";
}

TEST(Tracker, APlaceOfBeforeAJumpIsNotFlownTo) {
  BlownDrone drone;
  for (int i = 0; i < 300; ++i) drone.fly(drone.tracker.hold(drone.now));
  drone.position_m.x() = 3;  // as motion capture says it from now on
  for (int i = 0; i < 300; ++i) drone.fly(drone.tracker.hold(drone.now));
  EXPECT_NEAR(drone.position_m.x(), 3, 0.1);
}

TEST(Tracker, WhoDoesNotMoveAsSentIsNotCorrectedForAWhile) {
  BlownDrone drone;
  for (int i = 0; i < 30; ++i) drone.fly({});
  EXPECT_TRUE(drone.tracker.may_correct(drone.now));
  drone.tracker.on_sent(drone.now, {}, false);
  EXPECT_FALSE(drone.tracker.may_correct(drone.now));
  EXPECT_FALSE(drone.tracker.may_correct(drone.now + Tracker::moves_for_ns));
  EXPECT_TRUE(drone.tracker.may_correct(drone.now + Tracker::moves_for_ns + 1));
}

}  // namespace
}  // namespace ledgerline::link
