#include "ground/motion/response.hpp"

#include <gtest/gtest.h>

#include "ground/motion/predictor.hpp"
#include "tests/unit/ground/motion/reported_drone.hpp"

namespace ledgerline::ground::motion {
namespace {

/// What is learned in so many seconds around a square.
Response learned(const Response& truth, double seconds, double gust_mps, double noise_m, bool moves = true) {
  ReportedDrone drone(truth, gust_mps, noise_m);
  Predictor predictor{PredictorConfig{}};
  const TimeNs end_ns = drone.now_ns + from_seconds(seconds);
  for (TimeNs t = drone.now_ns; t < end_ns; t += state_period_ns) {
    while (drone.now_ns < t) {
      if (moves) drone.sent = around_a_square(drone.now_ns);
      drone.step();
    }
    predictor.observe(drone.state());
  }
  return predictor.response();
}

TEST(Response, GainLagAndDeadTimeAreLearnedInTenSeconds) {
  for (const Response& truth : {Response{1.0, 0.3, 0.1}, Response{0.7, 0.39, 0.05}, Response{1.3, 0.2, 0.16}}) {
    const Response response = learned(truth, 10, 0, 0);
    EXPECT_NEAR(response.gain, truth.gain, 0.03);
    EXPECT_NEAR(response.lag_s, truth.lag_s, 0.04);
    // Of steps that fall between two states half a period is seen as dead time, or as none.
    EXPECT_NEAR(response.lag_s + response.dead_s, truth.lag_s + truth.dead_s, 0.03);
  }
}

TEST(Response, GustsAndNoiseLeaveItCloseToTheTruth) {
  for (const Response& truth : {Response{1.0, 0.3, 0.1}, Response{0.7, 0.39, 0.05}, Response{1.3, 0.2, 0.16}}) {
    const Response response = learned(truth, 20, 0.05, 0.0005);
    EXPECT_NEAR(response.gain, truth.gain, 0.06);
    EXPECT_NEAR(response.lag_s + response.dead_s, truth.lag_s + truth.dead_s, 0.05);
  }
}

TEST(Response, NothingIsLearnedFromADroneThatHoversInTheWind) {
  const Response first;
  const Response response = learned({1.3, 0.2, 0.16}, 60, 0.02, 0.001, false);
  EXPECT_EQ(response.gain, first.gain);
  EXPECT_EQ(response.lag_s, first.lag_s);
}

TEST(Response, ADroneThatChangesIsLearnedAgain) {
  ResponseEstimator estimator({});
  ReportedDrone first({1.0, 0.3, 0.1}), second({0.7, 0.3, 0.1});
  std::deque<std::pair<TimeNs, Eigen::Vector2d>> sent;
  const auto sent_at = [&](TimeNs t) -> Eigen::Vector2d { return around_a_square(t).head<2>(); };
  for (ReportedDrone* drone : {&first, &second}) {
    estimator.interrupt();
    const TimeNs end_ns = drone->now_ns + 60 * ns_per_s;
    for (TimeNs t = drone->now_ns; t < end_ns; t += state_period_ns) {
      while (drone->now_ns < t) {
        drone->sent = around_a_square(drone->now_ns);
        drone->step();
      }
      // The second flight comes after the first.
      const TimeNs offset_ns = drone == &second ? 60 * ns_per_s : 0;
      estimator.add(drone->now_ns + offset_ns, drone->position.head<2>(), sent_at);
    }
    EXPECT_NEAR(estimator.response().gain, drone == &first ? 1.0 : 0.7, 0.1);
  }
}

TEST(Response, StaysWithinItsBoundsWhateverItIsFed) {
  ResponseEstimator estimator({});
  Random random(3);
  TimeNs t = 0;
  for (int i = 0; i < 20'000; ++i) {
    t += static_cast<TimeNs>(random.uniform() * 60) * ns_per_ms;
    const double huge = random.uniform() < 0.01 ? 1e6 : 1;
    estimator.add(t, huge * Eigen::Vector2d(random.normal(), random.normal()),
                  [&](TimeNs) { return Eigen::Vector2d(random.normal(), random.normal()); });
    const Response& r = estimator.response();
    ASSERT_GE(r.gain, ResponseEstimator::min_gain);
    ASSERT_LE(r.gain, ResponseEstimator::max_gain);
    ASSERT_GE(r.lag_s, ResponseEstimator::min_lag_s);
    ASSERT_LE(r.lag_s, ResponseEstimator::max_lag_s);
    ASSERT_GE(r.dead_s, 0);
    ASSERT_LE(r.dead_s, ResponseEstimator::candidates * ResponseEstimator::candidate_step_s);
  }
  EXPECT_GT(estimator.fitted(), 1'000U);
}

}  // namespace
}  // namespace ledgerline::ground::motion
