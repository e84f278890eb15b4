#include "ground/core/controller.hpp"

#include <gtest/gtest.h>

#include "tests/unit/ground/core/lagged_drone.hpp"

namespace ledgerline::ground {
namespace {

struct Flown {
  double rms_m = 0, max_m = 0, seconds = 0, worst_height_m = 0;
  bool finished = false;
};

// 30 states a second; a plan is there `delay_ms` after its state, and made for that moment.
Flown fly(Shape shape, double speed_mps, double delay_ms, double lag_s, double gust_mps) {
  ControllerConfig config;
  config.speed_mps = speed_mps;
  PathController controller(motion::waypoints_of(shape, 1.5), {0, 0}, config, 0.2);
  const double end_m = 3 * controller.lap_m();
  LaggedDrone drone(lag_s, gust_mps);
  drone.motion.position_m.z() = 1;
  drone.motion.yaw_rad = 0.2;
  controller.start(0, end_m);
  Flown flown;
  double squares = 0;
  int samples = 0;
  std::uint64_t plans = 0;
  for (TimeNs t = 0; t < 200 * ns_per_s; t += ns_per_s / 30) {
    drone.run_until(t);
    const double off = controller.path().distance_m(drone.motion.position_m.head<2>());
    squares += off * off;
    ++samples;
    flown.max_m = std::max(flown.max_m, off);
    flown.worst_height_m = std::max(flown.worst_height_m, std::abs(drone.motion.position_m.z() - 1));
    const TimeNs there = drone.motion.stamp_ns + static_cast<TimeNs>(delay_ms * ns_per_ms);
    controller.observe(drone.state());
    drone.deliver(there, controller.plan(++plans, there));
    if (controller.at_end() && drone.motion.position_m.head<2>().norm() < 0.1) {
      flown.finished = true;
      flown.seconds = to_seconds(t);
      break;
    }
  }
  flown.rms_m = std::sqrt(squares / samples);
  return flown;
}

PathController square_at(const Eigen::Vector2d& origin, double yaw_rad = 0) {
  return {motion::waypoints_of(Shape::square, 1.5), origin, {}, yaw_rad};
}

StateSample hovering(TimeNs stamp_ns, const Eigen::Vector3d& at) {
  StateSample state;
  state.phase = LinkPhase::flying;
  state.stamp_ns = state.pose_stamp_ns = stamp_ns;
  state.position_m = {at.x(), at.y(), at.z()};
  return state;
}

TEST(PathController, EachSetpointHasTheReferenceThatItBelongsTo) {
  PathController controller = square_at({0, 0});
  controller.start(0);
  controller.observe(hovering(1, {0, 0, 1}));
  const std::vector<Setpoint> plan = controller.plan(1, 1 + 100 * ns_per_ms);
  for (std::size_t i = 0; i < plan.size(); ++i) {
    ASSERT_TRUE(plan[i].has_reference);
    const Reference& reference = plan[i].reference;
    EXPECT_LT(controller.path().distance_m({reference.position_m[0], reference.position_m[1]}), 0.08);
    if (i == 0) continue;
    // As far as its velocity says.
    const Reference& before = plan[i - 1].reference;
    const double way_m =
        std::hypot(reference.position_m[0] - before.position_m[0], reference.position_m[1] - before.position_m[1]);
    const double mean_mps = 0.5 * (std::hypot(before.velocity_mps[0], before.velocity_mps[1]) +
                                   std::hypot(reference.velocity_mps[0], reference.velocity_mps[1]));
    EXPECT_NEAR(way_m, mean_mps * to_seconds(PathController::step_ns), 0.006);
  }
}

TEST(PathController, FollowsEveryShapeThroughLagAndDelay) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x, Shape::eight}) {
    for (double delay_ms : {20.0, 40.0}) {
      const Flown flown = fly(shape, 0.5, delay_ms, 0.3, 0);
      EXPECT_TRUE(flown.finished) << name_of(shape);
      EXPECT_LT(flown.rms_m, 0.03) << name_of(shape);
      EXPECT_LT(flown.max_m, 0.10) << name_of(shape);
      RecordProperty(name_of(shape) + "_rms_mm", static_cast<int>(1000 * flown.rms_m));
    }
  }
}

TEST(PathController, HoldsThePathInGusts) {
  for (Shape shape : {Shape::square, Shape::triangle, Shape::x}) {
    const Flown flown = fly(shape, 0.5, 30, 0.3, 0.1);
    EXPECT_TRUE(flown.finished) << name_of(shape);
    EXPECT_LT(flown.rms_m, 0.10) << name_of(shape);
  }
}

TEST(PathController, IsNotUpsetByADroneThatAnswersFasterOrSlowerThanAssumed) {
  for (double lag_s : {0.15, 0.5}) {
    const Flown flown = fly(Shape::square, 0.5, 30, lag_s, 0);
    EXPECT_TRUE(flown.finished) << lag_s;
    EXPECT_LT(flown.rms_m, 0.10) << lag_s;
  }
}

TEST(PathController, SlowsDownAtCornersRatherThanLeavingThePathAtSpeed) {
  const Flown flown = fly(Shape::square, 1.0, 30, 0.3, 0);
  EXPECT_TRUE(flown.finished);
  EXPECT_LT(flown.max_m, 0.12);
}

TEST(PathController, StaysOnThePathEvenWithHalfASecondOfDelay) {
  const Flown flown = fly(Shape::square, 0.5, 460, 0.3, 0);
  EXPECT_TRUE(flown.finished);
  EXPECT_LT(flown.rms_m, 0.10);
}

TEST(PathController, NeedsNoMoreThanAThirdLongerThanTheBareLength) {
  const Flown flown = fly(Shape::square, 0.5, 30, 0.3, 0);
  EXPECT_LT(flown.seconds, 1.33 * 18 / 0.5);
}

TEST(PathController, KeepsItsHeight) { EXPECT_LT(fly(Shape::square, 0.5, 30, 0.3, 0).worst_height_m, 0.02); }

TEST(PathController, PlansTwelveSetpointsAFiftiethOfASecondApartFromTheMomentAsked) {
  PathController controller = square_at({0, 0});
  const auto plan = controller.plan(1, 777);
  ASSERT_EQ(plan.size(), 12u);
  for (std::size_t i = 0; i < plan.size(); ++i) EXPECT_EQ(plan[i].at_ns, 777 + static_cast<TimeNs>(i) * 50 * ns_per_ms);
}

TEST(PathController, HoversAtTheOriginUntilItIsStarted) {
  PathController controller = square_at({1, 1});
  controller.observe(hovering(1, {0.8, 1, 0.7}));
  const auto plan = controller.plan(1, 1);
  EXPECT_GT(plan.front().velocity_mps[0], 0.1F);
  EXPECT_NEAR(plan.front().velocity_mps[1], 0, 0.15);  // to the middle of the rounded corner
  EXPECT_GT(plan.front().velocity_mps[2], 0.1F);
  EXPECT_EQ(controller.progress_m(), 0);
}

TEST(PathController, WaitsForADroneThatIsHeldBack) {
  PathController controller = square_at({0, 0});
  controller.start(0);
  std::uint64_t plans = 0;
  for (TimeNs t = 33 * ns_per_ms; t < 60 * ns_per_s; t += 33 * ns_per_ms) {
    controller.observe(hovering(t, {0, 0, 1}));
    (void)controller.plan(++plans, t + 20 * ns_per_ms);
  }
  EXPECT_LT(controller.progress_m(), 0.5);
}

TEST(PathController, TheReferenceWaitsWhileLinkBrakesOrThePoseIsLost) {
  for (const bool brakes : {true, false}) {
    PathController controller = square_at({0, 0});
    LaggedDrone drone(0.3);
    drone.motion.position_m = {0, 0, 1};
    controller.start(0);
    std::uint64_t plans = 0;
    const auto fly_until = [&](TimeNs until_ns) {
      for (TimeNs t = drone.motion.stamp_ns + ns_per_s / 30; t < until_ns; t += ns_per_s / 30) {
        drone.run_until(t);
        controller.observe(drone.state());
        drone.deliver(t + 20 * ns_per_ms, controller.plan(++plans, t + 20 * ns_per_ms));
      }
    };
    fly_until(2 * ns_per_s);
    const double before_m = controller.progress_m();
    EXPECT_GT(before_m, 0.3);
    // Poses stop; without a brake a pose of 300 ms is still taken for one.
    StateSample state = drone.state();
    state.sent_velocity_mps = {};
    state.mode = brakes ? FailsafeMode::brake : FailsafeMode::none;
    for (int i = 1; i <= 60; ++i) {
      state.stamp_ns = state.pose_stamp_ns + i * ns_per_s / 30;
      controller.observe(state);
      (void)controller.plan(++plans, state.stamp_ns + 20 * ns_per_ms);
    }
    EXPECT_LT(controller.progress_m() - before_m, brakes ? 0.03 : 0.25);
    drone.motion.stamp_ns = state.stamp_ns;
    fly_until(state.stamp_ns + 2 * ns_per_s);
    EXPECT_GT(controller.progress_m() - before_m, 0.4);  // and goes on
  }
}

// A ledger that stalls right after the start lets the drone fly its last plan far beyond the reference.
TEST(PathController, ADroneThatIsFarAheadComesBackAndGoesOn) {
  for (TimeNs under_way = 0; under_way < ns_per_s; under_way += 50 * ns_per_ms) {
    PathController controller = square_at({0, 0});
    LaggedDrone drone(0.3);
    drone.motion.position_m = {0, 0, 1};
    drone.motion.stamp_ns = 1;
    controller.start(0);
    controller.observe(drone.state());
    std::uint64_t plans = 0;
    for (TimeNs t = 0; t <= under_way; t += 50 * ns_per_ms) (void)controller.plan(++plans, t);
    drone.motion.stamp_ns = ns_per_s;
    drone.motion.position_m = {0.7, 0, 1};
    for (TimeNs t = ns_per_s; t < 10 * ns_per_s; t += ns_per_s / 30) {
      drone.run_until(t);
      const TimeNs there = t + 20 * ns_per_ms;
      controller.observe(drone.state());
      drone.deliver(there, controller.plan(++plans, there));
    }
    EXPECT_GT(controller.progress_m(), 1.5) << to_ms(under_way) << " ms after the start";
  }
}

TEST(PathController, TurnsBackToItsYawTheShortWay) {
  PathController controller = square_at({0, 0}, 3.1);
  StateSample state = hovering(1, {0, 0, 1});
  state.yaw_rad = -3.1;
  controller.observe(state);
  EXPECT_LT(controller.plan(1, 1).front().yaw_rate_radps, 0);
}

TEST(PathController, AStateWhoseTimesAreYearsApartTakesNoLongerThanAnyOther) {
  PathController controller = square_at({0, 0});
  controller.observe(hovering(1, {0, 0, 1}));
  controller.start(0);
  constexpr TimeNs years = INT64_MAX / 4;
  EXPECT_EQ(controller.plan(1, years).size(), PathController::steps);
  EXPECT_LT(controller.progress_m(), 2);
  StateSample late = hovering(years, {0, 0, 1});
  late.playout_margin_ns = years;
  controller.observe(late);
  EXPECT_EQ(controller.plan(2, years + ns_per_s).size(), PathController::steps);
}

TEST(PathController, NeverAsksForMoreThanItsSpeedAllows) {
  PathController controller = square_at({0, 0});
  controller.observe(hovering(1, {100, -100, 50}));
  for (const Setpoint& s : controller.plan(1, 1)) {
    EXPECT_LE(std::hypot(s.velocity_mps[0], s.velocity_mps[1]), 1.05 + 1e-6);
    EXPECT_LE(std::abs(s.velocity_mps[2]), 0.5 + 1e-6);
  }
}

TEST(PathController, ALapOfARampIsFasterThanTheOneBefore) {
  ControllerConfig config;
  config.ramp = {0.3, 0.2};
  const PathController controller(motion::waypoints_of(Shape::square, 1.5), {0, 0}, config, 0);
  EXPECT_DOUBLE_EQ(controller.requested_mps(0), 0.3);
  EXPECT_DOUBLE_EQ(controller.requested_mps(0.99 * controller.lap_m()), 0.3);
  EXPECT_DOUBLE_EQ(controller.requested_mps(2.5 * controller.lap_m()), 0.7);
}

TEST(PathController, ARampIsReadFromStartAndStep) {
  const auto ramp = ramp_from("0.5:0.1");
  ASSERT_TRUE(ramp.ok());
  EXPECT_DOUBLE_EQ(ramp->start_mps, 0.5);
  EXPECT_DOUBLE_EQ(ramp->step_mps, 0.1);
  for (const char* wrong : {"", "0.5", "0.5:", ":0.1", "0.5:0.1x", "nan:0.1", "0.5:-1", "9:0.1", "0.5:0.1:2"})
    EXPECT_FALSE(ramp_from(wrong).ok()) << wrong;
}

TEST(PathController, OldCommandsOfADroneThatIsNotKnownYetSlowItDownAndItSaysSo) {
  ControllerConfig config;
  config.speed_mps = 1.0;
  PathController controller(motion::waypoints_of(Shape::square, 1.5), {0, 0}, config, 0);
  controller.observe(hovering(1, {0, 0, 1}));
  controller.start(1);
  (void)controller.plan(1, 2 * ns_per_s);
  EXPECT_LT(controller.limit_mps(), 0.5);
  EXPECT_GE(controller.limit_mps(), config.min_limit_mps);
  ASSERT_TRUE(controller.slowed_to_mps());
  EXPECT_DOUBLE_EQ(*controller.slowed_to_mps(), controller.limit_mps());

  PathController near(motion::waypoints_of(Shape::square, 1.5), {0, 0}, config, 0);
  near.observe(hovering(1, {0, 0, 1}));
  near.start(1);
  (void)near.plan(1, 20 * ns_per_ms);
  EXPECT_FALSE(near.slowed_to_mps());
}

TEST(PathController, WithoutPredictionOneVelocityIsHeldUntilTheNextOneComes) {
  ControllerConfig config;
  config.predict = false;
  PathController controller(motion::waypoints_of(Shape::square, 1.5), {0, 0}, config, 0);
  controller.observe(hovering(5, {0, 0.1, 1}));
  controller.start(5);
  (void)controller.plan(1, 5);
  const auto plan = controller.plan(2, ns_per_s);
  for (const Setpoint& s : plan) EXPECT_EQ(s.velocity_mps, plan.front().velocity_mps);
  EXPECT_EQ(plan.back().at_ns - plan.front().at_ns, 1'500 * ns_per_ms);  // link holds the last one half a second
  EXPECT_NEAR(controller.progress_m(), config.speed_mps, 1e-6);          // it waits for nobody
  EXPECT_LT(plan.front().velocity_mps[1], 0);
}

TEST(PathController, WithoutPredictionWaypointsKeepTheirHeightsAndSpeeds) {
  const auto points = motion::waypoints_from_csv("0,0,1.5\n2,0,2,0.2\n2,2\n0,2\n", "f");
  ASSERT_TRUE(points.ok());
  ControllerConfig config;
  config.predict = false;
  PathController controller(*points, {0, 0}, config, 0);
  EXPECT_DOUBLE_EQ(controller.start_height_m(), 1.5);
  controller.observe(hovering(1, {0, 0, 1}));
  EXPECT_FLOAT_EQ(controller.plan(1, 1).front().velocity_mps[2], 0.5F);  // half a metre below its first point
  controller.start(1);
  const auto vertical_at = [&](TimeNs t, const Eigen::Vector3d& at) {
    controller.observe(hovering(t, at));
    return controller.plan(2, t).front().velocity_mps[2];
  };
  // 0.5 m/s along the first piece, half of it in 2 s, climbing a quarter of that.
  EXPECT_NEAR(vertical_at(1 + 2 * ns_per_s, {1, 0, 1.75}), 0.125F, 1e-5F);
  EXPECT_NEAR(controller.progress_m(), 1, 1e-6);
  // The second is flown at 0.2 m/s, falling from 2 m to the flight's own.
  (void)vertical_at(1 + 4 * ns_per_s, {2, 0, 2});
  EXPECT_NEAR(vertical_at(1 + 6 * ns_per_s, {2, 0.4, 1.8}), -0.1F, 1e-4F);
  EXPECT_NEAR(controller.progress_m(), 2.4, 1e-6);
}

}  // namespace
}  // namespace ledgerline::ground
