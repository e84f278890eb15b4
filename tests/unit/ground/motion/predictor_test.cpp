#include "ground/motion/predictor.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <vector>

#include "tests/unit/ground/motion/reported_drone.hpp"

namespace ledgerline::ground::motion {
namespace {

const Response known{1.0, 0.25, 0.08};

PredictorConfig knowing(const Response& response) {
  PredictorConfig config;
  config.first = response;
  config.learn = false;
  config.sent_acceleration_mps2 = 1e3;  // the drone of these tests is commanded in steps
  return config;
}

std::vector<Setpoint> plan_from(TimeNs first_ns, std::size_t count = 12) {
  std::vector<Setpoint> plan;
  for (std::size_t i = 0; i < count; ++i) {
    const TimeNs at_ns = first_ns + static_cast<TimeNs>(i) * 50 * ns_per_ms;
    const Eigen::Vector3d v = around_a_square(at_ns);
    plan.push_back({at_ns, {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())}, 0});
  }
  return plan;
}

/// A drone that flies plans `late_ns` later than they say, and a predictor that hears of it `delay_ns` later.
struct World {
  explicit World(const Response& response, double gust_mps = 0)
      : drone(response, gust_mps), predictor(knowing(known)) {}

  /// Plans for `delay_ns` after each state; returns the rms of what was predicted for that moment.
  double fly(double seconds, TimeNs delay_ns, TimeNs late_ns, const std::function<bool(int)>& lost = {}) {
    struct Expected {
      TimeNs at_ns;
      Eigen::Vector3d position;
    };
    std::deque<Expected> expected;
    double squares = 0;
    int count = 0, number = 0;
    const TimeNs end_ns = drone.now_ns + from_seconds(seconds);
    for (TimeNs next_ns = drone.now_ns; drone.now_ns < end_ns;) {
      if (drone.now_ns >= next_ns) {
        next_ns += state_period_ns;
        ++number;
        if (!lost || !lost(number)) {
          StateSample state = drone.state();
          state.playout_margin_ns = late_ns;
          predictor.observe(state);
          const auto plan = plan_from(drone.now_ns + delay_ns);
          predictor.sent(static_cast<std::uint64_t>(number), plan);
          const auto rollout = predictor.until(plan.front().at_ns);
          expected.push_back({rollout.effect().stamp_ns, rollout.effect().position_m});
        }
      }
      // What is flown is the same for every plan: what is commanded at a moment depends on that moment alone.
      const TimeNs meant_ns = (drone.now_ns - late_ns) / (50 * ns_per_ms) * (50 * ns_per_ms);
      drone.sent =
          drone.now_ns - late_ns < 100 * ns_per_s + delay_ns ? Eigen::Vector3d(0, 0, 0) : around_a_square(meant_ns);
      drone.step();
      while (!expected.empty() && expected.front().at_ns <= drone.now_ns) {
        if (drone.now_ns > 103 * ns_per_s) {
          squares += (expected.front().position - drone.position).squaredNorm();
          ++count;
        }
        expected.pop_front();
      }
    }
    return std::sqrt(squares / std::max(1, count));
  }

  ReportedDrone drone;
  Predictor predictor;
};

TEST(Predictor, SaysWhereADroneWillBeWhenAPlanTakesEffect) {
  for (const double delay_s : {0.01, 0.1, 0.5, 1.0, 2.0}) {
    World world(known);
    EXPECT_LT(world.fly(15, from_seconds(delay_s), 0), 0.025) << delay_s;
  }
}

TEST(Predictor, CountsThatLinkFliesSetpointsLater) {
  World world(known);
  EXPECT_LT(world.fly(15, from_seconds(0.4), from_seconds(0.3)), 0.025);
}

TEST(Predictor, GapsAndLostStatesCostLittle) {
  World world(known);
  // Eight of each twenty are lost, in a row: a gap of a quarter of a second.
  EXPECT_LT(world.fly(15, from_seconds(0.3), 0, [](int number) { return number % 20 < 8; }), 0.06);
}

TEST(Predictor, WithoutTheModelItWouldBeFarOff) {
  // The same drone, predicted by one that thinks it answers at once: what the others' bounds are worth.
  World world({1.0, 0.6, 0.2});
  EXPECT_GT(world.fly(15, from_seconds(0.5), 0), 0.1);
}

TEST(Predictor, LearnsASteadyWind) {
  World world(known);
  world.drone.wind = {0.1, -0.05, 0};
  EXPECT_LT(world.fly(20, from_seconds(0.5), 0), 0.03);
  EXPECT_NEAR(world.predictor.drift_mps().x(), 0.1, 0.03);
  EXPECT_NEAR(world.predictor.drift_mps().y(), -0.05, 0.03);
}

StateSample at(TimeNs stamp_ns, double x) {
  StateSample s;
  s.phase = LinkPhase::flying;
  s.stamp_ns = s.pose_stamp_ns = stamp_ns;
  s.position_m = {x, 0, 1};
  return s;
}

std::vector<Setpoint> steady(TimeNs first_ns, float mps, int count) {
  std::vector<Setpoint> plan;
  for (int i = 0; i < count; ++i) plan.push_back({first_ns + i * 50 * ns_per_ms, {mps, 0, 0}, 0});
  return plan;
}

TEST(Predictor, AStateThatIsNotNewerChangesNothing) {
  Predictor one(knowing(known)), two(knowing(known));
  for (int i = 1; i < 40; ++i) {
    const StateSample state = at(i * state_period_ns, 0.01 * i);
    one.observe(state);
    two.observe(state);
    two.observe(state);                                                     // twice
    if (i > 3) two.observe(at((i - 3) * state_period_ns, 0.01 * (i - 3)));  // out of order
  }
  EXPECT_EQ(one.newest().position_m, two.newest().position_m);
  EXPECT_EQ(one.newest().velocity_mps, two.newest().velocity_mps);
  EXPECT_EQ(one.until(3 * ns_per_s).effect().position_m, two.until(3 * ns_per_s).effect().position_m);
}

TEST(Predictor, WhatTheDroneWasSentCountsWithoutANewPose) {
  Predictor predictor(knowing(known));
  const auto flying_on = steady(ns_per_s, 0.7F, 100);
  TimeNs t = ns_per_s;
  for (int i = 0; i < 60; ++i, t += state_period_ns) {
    StateSample state = at(t, 0.7 * to_seconds(t - ns_per_s));
    state.velocity_mps = {0.7, 0, 0};
    state.sent_velocity_mps = {0.7F, 0, 0};
    predictor.observe(state);
  }
  predictor.sent(1, flying_on);
  const Motion last = predictor.newest();
  // Mocap is away for a second: link brakes, and the plan goes on speaking of 0.7 m/s.
  StateSample braking = at(t, last.position_m.x());
  for (int i = 0; i < 30; ++i, t += state_period_ns) {
    braking.stamp_ns = t;
    braking.pose_stamp_ns = last.stamp_ns;
    braking.mode = FailsafeMode::brake;
    predictor.observe(braking);
  }
  EXPECT_EQ(predictor.newest().stamp_ns, last.stamp_ns);
  const double on_m = predictor.until(t).effect().position_m.x() - last.position_m.x();
  EXPECT_LT(on_m, 0.7 * (known.lag_s + known.dead_s + 0.1));
  EXPECT_GT(on_m, 0.7 * known.lag_s);
}

TEST(Predictor, WhatTheDroneWasOrderedToTurnSinceItsPoseIsInItsHeading) {
  constexpr TimeNs old_ns = 200 * ns_per_ms;
  constexpr float rate_radps = 1.75F;
  Predictor predictor(knowing(known));
  StateSample state;
  TimeNs t = ns_per_s;
  for (int i = 0; i < 60; ++i, t += state_period_ns) {
    state = at(t, 0);
    state.pose_stamp_ns = t - old_ns;
    state.yaw_rad = static_cast<double>(rate_radps) * to_seconds(state.pose_stamp_ns - ns_per_s);
    state.sent_yaw_rate_radps = rate_radps;
    predictor.observe(state);
  }
  std::vector<Setpoint> turning = steady(state.stamp_ns, 0, 12);
  for (Setpoint& setpoint : turning) setpoint.yaw_rate_radps = rate_radps;
  predictor.sent(1, turning);
  for (const TimeNs ahead_ns : {-old_ns / 2, TimeNs{0}, old_ns}) {
    const auto rollout = predictor.until(state.stamp_ns + ahead_ns);
    EXPECT_NEAR(rollout.effect().yaw_rad - state.yaw_rad,
                static_cast<double>(rate_radps) * to_seconds(old_ns + ahead_ns), 1e-6)
        << to_ms(ahead_ns);
  }
}

TEST(Predictor, AWithdrawnPlanIsNotFlown) {
  Predictor predictor(knowing(known));
  predictor.observe(at(ns_per_s, 0));
  predictor.sent(1, steady(ns_per_s, 1, 20));
  EXPECT_GT(predictor.until(2 * ns_per_s).effect().position_m.x(), 0.5);
  predictor.withdraw(1);
  EXPECT_NEAR(predictor.until(2 * ns_per_s).effect().position_m.x(), 0, 0.01);
}

TEST(Predictor, ANewerPlanReplacesTheOlderFromItsFirstSetpointOn) {
  Predictor predictor(knowing(known));
  predictor.observe(at(ns_per_s, 0));
  predictor.sent(1, steady(ns_per_s, 1, 40));
  predictor.sent(2, steady(3 * ns_per_s / 2, 0, 40));
  const double when_stopped = predictor.until(3 * ns_per_s / 2).effect().position_m.x();
  const double later = predictor.until(3 * ns_per_s).effect().position_m.x();
  EXPECT_GT(when_stopped, 0.1);
  EXPECT_NEAR(later - when_stopped, known.lag_s, 0.05);  // what a drone of 1 m/s still rolls on
}

TEST(Predictor, BehindAPlansEndTheDroneIsOrderedToStopAsLinkDoes) {
  struct Case {
    std::vector<Setpoint> plan;
    TimeNs hold_ns;  // of the last setpoint
  };
  const std::vector<Setpoint> far_apart{{ns_per_s, {1, 0, 0}, 0}, {2 * ns_per_s, {1, 0, 0}, 0}};
  for (const Case& one : {Case{steady(ns_per_s, 1, 10), 50 * ns_per_ms}, Case{steady(ns_per_s, 1, 1), 100 * ns_per_ms},
                          Case{far_apart, 500 * ns_per_ms}}) {
    Predictor predictor(knowing(known));
    predictor.observe(at(ns_per_s, 0));
    predictor.sent(1, one.plan);
    const TimeNs end_ns = one.plan.back().at_ns + one.hold_ns;
    // Flown at 1 m/s to its end; less what it took to get there it rolls on for as much.
    const double end_m = predictor.until(end_ns + ns_per_s).effect().position_m.x();
    EXPECT_NEAR(end_m, to_seconds(end_ns - ns_per_s), 0.05) << to_seconds(end_ns);
    EXPECT_LT(end_m - predictor.until(end_ns).effect().position_m.x(), known.lag_s);
  }
}

TEST(Predictor, WhatIsCommittedIsWhereThePlansTakeItStepByStep) {
  constexpr TimeNs late_ns = 20 * ns_per_ms;
  Predictor predictor(knowing(known));
  StateSample state = at(ns_per_s, 0);
  state.playout_margin_ns = late_ns;
  predictor.observe(state);
  const auto plan = steady(ns_per_s + 300 * ns_per_ms, 1, 12);
  predictor.sent(1, plan);
  const TimeNs from_ns = ns_per_s + 40 * ns_per_ms, dead_ns = from_seconds(known.dead_s);
  const std::vector<Motion> committed = predictor.committed(from_ns, 24);
  ASSERT_EQ(committed.size(), 21U) << "960 ms, one each 50 ms, and the last";
  EXPECT_EQ(committed.front().stamp_ns, from_ns);
  EXPECT_EQ(committed.back().stamp_ns, plan.back().at_ns + 50 * ns_per_ms + late_ns + dead_ns);
  for (const Motion& motion : committed) {
    const Motion alone = predictor.until(motion.stamp_ns - dead_ns - late_ns).effect();
    EXPECT_NEAR((motion.position_m - alone.position_m).norm(), 0, 0.005) << to_ms(motion.stamp_ns - from_ns);
  }
  EXPECT_EQ(committed.front().position_m.x(), 0) << "the plan has not begun";
  EXPECT_GT(committed.back().position_m.x(), 0.3);
  EXPECT_EQ(predictor.newest().position_m.x(), 0) << "looking changes nothing";
}

TEST(Predictor, AWithdrawnPlanIsNotCommitted) {
  Predictor predictor(knowing(known));
  EXPECT_TRUE(predictor.committed(ns_per_s, 24).empty()) << "nothing is known";
  predictor.observe(at(ns_per_s, 0));
  EXPECT_TRUE(predictor.committed(ns_per_s, 24).empty()) << "nothing is sent";
  predictor.sent(1, steady(ns_per_s, 1, 12));
  const auto ahead = [&] { return predictor.committed(ns_per_s, 24).back().position_m; };
  const Eigen::Vector3d by_first = ahead();
  predictor.sent(2, steady(ns_per_s + 50 * ns_per_ms, -1, 12));
  EXPECT_LT(ahead().x(), -0.2);
  predictor.withdraw(2);
  EXPECT_EQ(ahead(), by_first);
  predictor.withdraw(1);
  EXPECT_TRUE(predictor.committed(ns_per_s, 24).empty());
}

TEST(Predictor, WhatIsFlownIsNotCommittedAnyMore) {
  Predictor predictor(knowing(known));
  predictor.observe(at(ns_per_s, 0));
  predictor.sent(1, steady(ns_per_s, 1, 12));
  const TimeNs end_ns = ns_per_s + 600 * ns_per_ms + from_seconds(known.dead_s);
  EXPECT_EQ(predictor.committed(end_ns - ns_per_ms, 24).size(), 2U);
  EXPECT_TRUE(predictor.committed(end_ns, 24).empty());
}

TEST(Predictor, HoweverFarThePlansReachTheCommittedPathHasNoMorePointsThanAskedFor) {
  Predictor predictor(knowing(known));
  predictor.observe(at(ns_per_s, 0));
  for (const TimeNs ahead_ns : {ns_per_s, 3 * ns_per_s, 3'600 * ns_per_s}) {
    predictor.sent(1, steady(ns_per_s + ahead_ns, 1, 40));
    const auto committed = predictor.committed(ns_per_s, 24);
    ASSERT_LE(committed.size(), 24U);
    ASSERT_GE(committed.size(), 12U);
    const TimeNs step_ns = committed[1].stamp_ns - committed[0].stamp_ns;
    EXPECT_EQ(step_ns % (50 * ns_per_ms), 0);
    for (std::size_t i = 1; i + 1 < committed.size(); ++i)
      EXPECT_EQ(committed[i].stamp_ns - committed[i - 1].stamp_ns, step_ns);
    EXPECT_LE(committed.back().stamp_ns, ns_per_s + Predictor::max_ns + from_seconds(known.dead_s));
  }
}

TEST(Predictor, APlanInTheDronesOwnFrameGoesWhereItLooks) {
  Predictor predictor(knowing(known));
  StateSample state = at(ns_per_s, 0);
  state.yaw_rad = std::numbers::pi / 2;
  predictor.observe(state);
  predictor.sent(1, steady(ns_per_s, 1, 20), true);
  const Eigen::Vector3d straight = predictor.committed(ns_per_s, 24).back().position_m;
  EXPECT_NEAR(straight.x(), 0, 1e-6);
  EXPECT_GT(straight.y(), 0.6);
  std::vector<Setpoint> turning = steady(ns_per_s, 1, 20);
  for (Setpoint& setpoint : turning) setpoint.yaw_rate_radps = 1.5F;
  predictor.sent(2, turning, true);
  const Motion turned = predictor.committed(ns_per_s, 24).back();
  EXPECT_NEAR(turned.yaw_rad - state.yaw_rad, 1.5, 1e-3);
  EXPECT_LT(turned.position_m.x(), -0.2) << "counter-clockwise: to its left";
}

TEST(Predictor, SentVelocitiesChangeNoFasterThanLinkLetsThem) {
  PredictorConfig slow = knowing(known);
  slow.sent_acceleration_mps2 = 1;
  Predictor predictor(slow);
  predictor.observe(at(ns_per_s, 0));
  auto rollout = predictor.until(ns_per_s);
  rollout.send({1, 0, 0}, 0, ns_per_s + 500 * ns_per_ms, slow.sent_acceleration_mps2);
  EXPECT_NEAR(rollout.sent_mps().x(), 0.5, 1e-6);
}

TEST(Predictor, AJumpOrALongPauseRestartsTheFilter) {
  Predictor predictor(knowing(known));
  for (int i = 1; i < 40; ++i) predictor.observe(at(i * state_period_ns, 0.02 * i));
  predictor.observe(at(40 * state_period_ns, 5));
  EXPECT_EQ(predictor.newest().position_m.x(), 5);
  EXPECT_EQ(predictor.newest().velocity_mps.x(), 0);
  predictor.observe(at(40 * state_period_ns + 2 * ns_per_s, 5.2));
  EXPECT_EQ(predictor.newest().position_m.x(), 5.2);
}

TEST(Predictor, TimesYearsApartCostNoMoreThanOthers) {
  Predictor predictor(knowing(known));
  predictor.observe(at(ns_per_s, 0));
  constexpr TimeNs years = INT64_MAX / 4;
  EXPECT_LE(predictor.until(years).sent_until_ns(), ns_per_s + Predictor::max_ns + ns_per_s);
  StateSample far = at(years, 0);
  far.playout_margin_ns = INT64_MAX / 8;
  predictor.observe(far);
  EXPECT_TRUE(predictor.until(years).effect().position_m.allFinite());
  EXPECT_TRUE(predictor.until(0).effect().position_m.allFinite());
}

}  // namespace
}  // namespace ledgerline::ground::motion
