#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <cstdio>
#include <numbers>

#include "common/base/random.hpp"
#include "common/config/config.hpp"
#include "onboard/link/core/pose/odometry.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/tools/tello/calibrate/world.hpp"

/// Onboard odometry of drones whose own velocity differs as far as one of a Tello that nobody measured may: is the
/// error that is made the variance that is reported, with link's defaults, and with what `calibrate` measures of each?
namespace ledgerline::tello {
namespace {

/// Drone number `seed`: its velocity's scale, lag, cast and bias are drawn.
Drone drawn(int seed) {
  Random random(static_cast<std::uint64_t>(seed));
  Drone drone;
  drone.parameters.seed = random.next();
  drone.parameters.start_yaw_rad = std::numbers::pi * (2 * random.uniform() - 1);
  sim::SensorParameters& sensors = drone.parameters.sensors;
  sensors.flow_scale = 0;
  sensors.flow_scale_offset = 0.6 * random.uniform() - 0.3;
  sensors.velocity_lag_s = 0.1 + 0.2 * random.uniform();
  sensors.velocity_truncated = random.uniform() < 0.5;
  const auto bias = std::polar(0.05, 2 * std::numbers::pi * random.uniform());
  sensors.flow_bias_mps = {bias.real(), bias.imag()};
  return drone;
}

/// Flies three laps of a square of 2 m at 0.5 m/s by its odometry, a minute, put down as exactly as the settings say.
/// Returns the normalised squared error of its horizontal position by the variances that are reported,
/// (e_x^2 / P_xx + e_y^2 / P_yy) / 2, the mean over the flight: 1 where they are right.
double flown_nees(const Drone& drone, link::OdometrySettings settings) {
  Random put(drone.parameters.seed);
  settings.start_m = {settings.start_sigma_m * put.normal(), settings.start_sigma_m * put.normal(), 0};
  settings.start_yaw_rad = drone.parameters.start_yaw_rad + settings.start_sigma_rad * put.normal();
  link::Odometry odometry(settings);
  sim::Simulator simulator(drone.parameters, 0);
  constexpr sim::Endpoint client{1, 40000};
  constexpr std::array<std::complex<double>, 4> corners{{{2, 0}, {2, 2}, {0, 2}, {0, 0}}};
  constexpr std::size_t to_fly = 3 * corners.size();
  std::size_t reached = 0;
  double sum = 0;
  int samples = 0;
  for (TimeNs now = ns_per_ms; reached < to_fly && now < 180 * ns_per_s; now += ns_per_ms) {
    if (now == 100 * ns_per_ms) simulator.datagram(1, client, "command");
    if (now == 500 * ns_per_ms) simulator.datagram(1, client, "takeoff");
    for (const sim::Outgoing& datagram : simulator.step(now).datagrams) {
      link::TelloState state;
      if (!link::parse_state(datagram.bytes, state)) continue;
      const sim::Truth truth = simulator.truth(1);
      odometry.on_state(now, state, !truth.in_flight);
      if (now < 8 * ns_per_s) continue;  // it takes off
      const Pose& pose = odometry.pose();
      for (std::size_t i = 0; i < 2; ++i)
        sum += std::pow(pose.position_m[i] - truth.position_m[i], 2) / static_cast<double>(pose.variance[i]) / 2;
      ++samples;
      const auto to = corners[reached % corners.size()] - std::complex(pose.position_m[0], pose.position_m[1]);
      if (std::abs(to) < 0.1) ++reached;
      const auto body = to * std::polar(std::min(1.0, 0.5 / std::abs(to)), -pose.yaw_rad);
      const auto percent = [](double mps) { return static_cast<int>(std::lround(100 * mps)); };
      simulator.datagram(1, client, link::rc_text({percent(-body.imag()), percent(body.real()), 0, 0}).view());
    }
  }
  EXPECT_EQ(reached, to_fly);
  return sum / samples;
}

/// Link's settings by the file that calibrate writes of this drone.
link::OdometrySettings calibrated(const Drone& drone) {
  World world(drone, {.repeat = 2, .poses = true});
  world.fly();
  EXPECT_EQ(world.flight.failure(), "");
  const auto c = estimate(world.flight.record());
  EXPECT_TRUE(c && c->velocity) << (c ? c->velocity.error().message : c.error().message);
  auto config = Config::parse(c ? toml(*c) : "", "calibration.toml");
  EXPECT_TRUE(config) << config.error().message;
  return link::read_pose(*config).odometry;
}

struct Nees {
  double drifting = 0;  ///< of the drones as they are drawn
  double steady = 0;    ///< without their bias, and known to have none: it is the most of the error of a minute
};

/// Means of drones 1 to `count`.
template <typename Settings>
Nees mean_nees(int count, Settings settings_of) {
  Nees mean;
  for (int seed = 1; seed <= count; ++seed) {
    SCOPED_TRACE(seed);
    Drone drone = drawn(seed);
    link::OdometrySettings settings = settings_of(drone);
    mean.drifting += flown_nees(drone, settings) / count;
    drone.parameters.sensors.flow_bias_mps = {};
    settings.flow_mps = 1.1 * drone.parameters.sensors.flow_mps;
    settings.flow_s = drone.parameters.sensors.flow_s;
    mean.steady += flown_nees(drone, settings) / count;
  }
  std::printf("normalised squared error, mean of %d drones: %.2f, without a bias %.2f\n", count, mean.drifting,
              mean.steady);
  return mean;
}

TEST(DrawnDrones, WithDefaultsTheErrorIsTheVarianceThatIsReported) {
  const Nees nees = mean_nees(seeds(slow ? 1 : 40, 200), [](const Drone&) { return link::OdometrySettings{}; });
  if (slow) return;  // statistics want more drones
  for (const double value : {nees.drifting, nees.steady}) {
    EXPECT_LT(value, 2);
    EXPECT_GT(value, 0.5) << "a variance that is too large draws the fence in for nothing";
  }
}

TEST(DrawnDrones, BehindCalibrateTheErrorIsTheVarianceThatIsReported) {
  const Nees nees = mean_nees(seeds(slow ? 1 : 40, 100), calibrated);
  if (slow) return;
  for (const double value : {nees.drifting, nees.steady}) {
    EXPECT_LT(value, 1.5);
    EXPECT_GT(value, 0.5);
  }
}

}  // namespace
}  // namespace ledgerline::tello
