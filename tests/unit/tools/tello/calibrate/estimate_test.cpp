#include "tools/tello/core/calibrate/estimate.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "common/config/config.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/tools/tello/calibrate/world.hpp"

namespace ledgerline::tello {
namespace {

struct Truth {
  double full_mps = 0, lag_s = 0, dead_s = 0;
};

/// What this drone really does, without wind, noise or a way to it, seen at 100 Hz by nobody but sim: rc that changes
/// its sign each two seconds, and the first order with dead time that is nearest to its velocity, by another code than
/// that under test: Euler steps, and all of a grid.
Truth truth_of(const Drone& drone) {
  sim::Parameters p = drone.parameters;
  p.wind.gust_mps = 0;
  p.sensors.flow_mps = 0;  // its scale stays, which is what this one drone has
  sim::Simulator simulator(p, 0);
  const double way = p.start_yaw_rad;
  std::vector<double> sent, flown;
  for (int ms = 0; ms < 19'000; ++ms) {
    if (ms == 100) simulator.datagram(1, {1, 1}, "command");
    if (ms == 200) simulator.datagram(1, {1, 1}, "takeoff");
    if (ms >= 10'000 && (ms - 10'000) % 2000 == 0)
      simulator.datagram(1, {1, 1}, (ms / 2000) % 2 == 1 ? "rc 0 35 0 0" : "rc 0 -35 0 0");
    simulator.step(ms * ns_per_ms);
    if (ms < 10'000 || ms % 10 != 0) continue;
    const auto v = simulator.truth(1).velocity_mps;
    sent.push_back((ms / 2000) % 2 == 1 ? 0.35 : -0.35);
    flown.push_back(std::cos(way) * v[0] + std::sin(way) * v[1]);
  }
  Truth best;
  double least = 1e9;
  for (int dead = 0; dead < 30; ++dead)
    for (int lag = 5; lag < 60; ++lag) {
      double v = 0, uu = 0, uv = 0, vv = 0;
      for (std::size_t i = 0; i < sent.size(); ++i) {
        uu += v * v;
        uv += v * flown[i];
        vv += flown[i] * flown[i];
        const double u = i < static_cast<std::size_t>(dead) ? 0 : sent[i - static_cast<std::size_t>(dead)];
        v += (u - v) * (1 - std::exp(-1.0 / lag));
      }
      if (const double squares = vv - uv * uv / uu; squares < least) {
        least = squares;
        best = {uv / uu, lag * 0.01, dead * 0.01};
      }
    }
  return best;
}

std::array<int, 4> signs_of(const Drone& drone) {
  // What a Tello obeys, a to the right and d clockwise, against left, forward, up, counter-clockwise.
  return {-drone.rc_signs[0], drone.rc_signs[1], drone.rc_signs[2], -drone.rc_signs[3]};
}

double degrees_between(double a, double b) {
  return std::abs(std::remainder(a - b, 2 * std::numbers::pi)) * 180 / std::numbers::pi;
}

class FiveDrones : public ::testing::TestWithParam<std::size_t> {
 protected:
  /// Wind, noise and what its own flow is worth come from the seed.
  void meet(int seed) { drone.parameters.seed = 100 * static_cast<std::uint64_t>(seed) + GetParam(); }
  Record flown(bool poses) const {
    World world(drone, {.repeat = 2, .poses = poses});
    double furthest = 0;
    while (!world.flight.over() && world.now < 400 * ns_per_s) {
      world.step();
      furthest = std::max({furthest, std::abs(world.truth().position_m[0]), std::abs(world.truth().position_m[1])});
    }
    EXPECT_EQ(world.flight.failure(), "");
    EXPECT_FALSE(world.truth().motors_on);
    EXPECT_LT(furthest, 1.5);
    EXPECT_LT(world.now, 160 * ns_per_s);
    return world.flight.record();
  }
  void expect_near(const Calibration& c, double share, double s) const {
    const Truth truth = truth_of(drone);
    const double delay = to_seconds(drone.delay_ns);
    EXPECT_NEAR(c.along.full_scale.value, truth.full_mps, share * truth.full_mps);
    EXPECT_NEAR(c.along.lag_s.value, truth.lag_s, s);
    EXPECT_NEAR(c.along.dead_s.value, truth.dead_s + delay, s);
    EXPECT_NEAR(c.up.full_scale.value, drone.parameters.sdk.rc_full_mps, share * drone.parameters.sdk.rc_full_mps);
    const double turns = drone.parameters.sdk.rc_full_yaw_degps * std::numbers::pi / 180;
    EXPECT_NEAR(c.turning.full_scale.value, turns, share * turns);
    EXPECT_NEAR(c.turning.lag_s.value, drone.parameters.control.yaw_rate_lag_s, s);
    EXPECT_NEAR(c.turning.dead_s.value, delay, s);
    EXPECT_EQ(c.rc_signs, signs_of(drone));
    EXPECT_EQ(c.velocity_signs, drone.vg_signs);
    EXPECT_EQ(c.velocity_in_body, drone.vg_in_body);
  }

  Drone drone = five_drones()[GetParam()];
};

TEST_P(FiveDrones, AreMeasuredByPoses) {
  sim::SensorParameters& sensors = drone.parameters.sensors;
  sensors.flow_scale = 0;
  sensors.flow_scale_offset = std::array{-0.3, 0.3, 0.0, -0.15, 0.15}[GetParam()];
  sensors.velocity_lag_s = std::array{0.1, 0.3, 0.2, 0.12, 0.15}[GetParam()];
  sensors.velocity_truncated = GetParam() % 2 == 0;
  for (int seed = 1; seed <= seeds(1, 40); ++seed) {
    meet(seed);
    Record record = flown(true);
    const auto c = estimate(record);
    ASSERT_TRUE(c) << seed << ": " << c.error().message;
    SCOPED_TRACE(seed);
    for (TelloStateSample& text : record.states) text.state.velocity_dmps = {};
    EXPECT_FALSE(estimate(record)) << "of a flow that sees nothing no frame is known";
    expect_near(*c, 0.03, 0.020);
    ASSERT_TRUE(c->nose_rad && c->power_on_rad);
    EXPECT_LT(degrees_between(c->nose_rad->value, drone.mount_rad), 1);
    EXPECT_LT(degrees_between(c->power_on_rad->value, drone.parameters.start_yaw_rad), 1);
    ASSERT_TRUE(c->velocity) << c->velocity.error().message;
    EXPECT_NEAR(c->velocity->scale.value * (1 + sensors.flow_scale_offset), 1, 0.03);
    EXPECT_NEAR(c->velocity->lag_s.value, sensors.velocity_lag_s, 0.03);
    EXPECT_EQ(c->velocity->truncated, sensors.velocity_truncated);
  }
}

TEST_P(FiveDrones, AreMeasuredByTheirOwnWords) {
  for (int seed = 1; seed <= seeds(1, 40); ++seed) {
    meet(seed);
    const auto c = estimate(flown(false));
    ASSERT_TRUE(c) << seed << ": " << c.error().message;
    SCOPED_TRACE(seed);
    expect_near(*c, 0.10, 0.060);
    EXPECT_FALSE(c->nose_rad);
    EXPECT_FALSE(c->velocity) << "what was sent is no reference: by a wrong scale it flies at the wrong speed";
  }
}

INSTANTIATE_TEST_SUITE_P(Calibration, FiveDrones, ::testing::Range(std::size_t{0}, std::size_t{slow ? 2 : 5}));

// By the closed form of a first order between two steps, not by the code under test.
TEST(Fit, AFirstOrderWithDeadTimeIsFoundExactly) {
  constexpr double lag = 0.273, dead = 0.117, gain = 1.3, bias = 0.05;
  Stretch stretch{{{1.0, 0.3}, {2.0, -0.36}, {4.0, 0.4}, {6.0, -0.38}}, 8.0, {{}}};
  for (double t = 1.01; t < 8; t += 0.037) {
    double v = 0, u = 0, since = 1.0;
    for (const Step& step : stretch.steps) {
      const double until = std::min(t, step.at_s + dead);
      v = u + (v - u) * std::exp(-(until - since) / lag);
      since = until;
      if (t < step.at_s + dead) break;
      u = step.u;
    }
    v = u + (v - u) * std::exp(-(t - since) / lag);
    stretch.axes[0].push_back({t, t, gain * v + bias});
  }
  const auto fit = fit_response({stretch, stretch});
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->lag_s, lag, 0.003);
  EXPECT_NEAR(fit->dead_s, dead, 0.003);
  EXPECT_NEAR(fit->gains[1][0], gain, 0.005);
  EXPECT_NEAR(fit->at_rest[0][0], bias, 0.005);
  stretch.axes[0].resize(10);
  EXPECT_FALSE(fit_response({stretch}));
}

TEST(Calibration, OfAFlightWithoutPosesLeavesLinksDefaultsAndSaysSo) {
  const std::string text = toml({});
  EXPECT_NE(text.find("# No velocity_scale, velocity_truncated, velocity_lag_s: without poses"), std::string::npos);
  EXPECT_EQ(text.find("\nvelocity_scale"), std::string::npos);
}

TEST(Velocity, OfADroneThatHoversSaysNothing) {
  std::vector<VelocityBlock> blocks(4);
  for (VelocityBlock& block : blocks)
    for (double t = 0; t < 8; t += 0.1) {
      block.reported.push_back({t, 0});
      block.positions.push_back({t, {0.02 * t, 0.0}});
    }
  EXPECT_FALSE(fit_velocity(blocks));
  blocks.resize(2);
  EXPECT_FALSE(fit_velocity(blocks)) << "two have no spread";
}

TEST(Calibration, IsTomlWithTheKeysOfLinkAndGround) {
  Calibration c;
  c.along.full_scale = {1.25, 0.01};
  c.turning.full_scale = {1.5, 0.02};
  c.along.lag_s = {0.31, 0.004};
  c.rc_signs = {-1, 1, 1, -1};
  c.velocity_signs = {-1, 1, -1};
  c.velocity_in_body = true;
  c.velocity = VelocityFit{.scale = {1.25, 0.025}, .lag_s = {0.15, 0.015}, .truncated = true, .cast = {0.95, 0.05}};
  auto config = Config::parse(toml(c), "calibration.toml");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_NEAR(config->number({"rc.full_scale_mps", "."}, 0, 0.1, 20), 1.25, 1e-6);
  EXPECT_NEAR(config->number({"rc.full_scale_radps", "."}, 0, 0.1, 20), 1.5, 1e-6);
  EXPECT_EQ(config->numbers({"rc.signs", "."}, 4, {0, 0, 0, 0}), (std::vector<double>{-1, 1, 1, -1}));
  EXPECT_EQ(config->numbers({"pose.velocity_signs", "."}, 3, {0, 0, 0}), (std::vector<double>{-1, 1, -1}));
  EXPECT_EQ(config->choice({"pose.velocity_frame", "."}, {"power_on", "body"}, "power_on"), "body");
  EXPECT_NEAR(config->number({"pose.velocity_scale", "."}, 0, 0.5, 2), 1.25, 1e-6);
  EXPECT_NEAR(config->number({"pose.flow_scale", "."}, 0, 0, 0.5), std::hypot(0.02, 0.02), 1e-3);
  EXPECT_TRUE(config->boolean({"pose.velocity_truncated", "."}, false));
  EXPECT_NEAR(config->number({"pose.velocity_lag_s", "."}, 0, 0, 1), 0.15, 1e-6);
  EXPECT_NEAR(config->number({"pose.velocity_lag_sd_s", "."}, 0, 0, 1), std::hypot(0.015, 0.02), 1e-3);
  EXPECT_NEAR(config->number({"flight.full_scale_mps", "."}, 0, 0.1, 20), 1.25, 1e-6);
  EXPECT_NEAR(config->number({"flight.lag_s", "."}, 0, 0.01, 2), 0.31, 1e-6);
  EXPECT_TRUE(config->finish());
}

}  // namespace
}  // namespace ledgerline::tello
