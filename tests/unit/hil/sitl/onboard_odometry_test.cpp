#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>

#include "hil/sitl/world.hpp"
#include "sim/core/sensors.hpp"
#include "tests/unit/campaign.hpp"

/// Flights by the drone's own odometry, without motion capture: the place that it tells against the truth, and the
/// variance that it tells against the error.
namespace ledgerline::hil {
namespace {

struct Report {
  double normalised_squared = 0;  ///< sum over x and y
  int samples = 0, inside = 0;    ///< of each axis; within three sigmas
  double max_error_m = 0, last_error_m = 0, last_sigma_m = 0;
  bool ok = false;
  std::string why;
};

WorldConfig square(std::uint64_t seed, int laps, link::PoseSource source) {
  WorldConfig config;
  config.seed = seed;
  config.pose = source;
  config.side_m = 2;
  config.laps = laps;
  config.calibrated = true;
  config.room_m.reset();
  if (source == link::PoseSource::pads) config.pads = sim::parse_pads("1:0:0,2:2:0:90,3:2:2:200,4:0:2:-30").value();
  config.start_error_m = link::OdometrySettings{}.start_sigma_m;
  config.start_error_rad = link::OdometrySettings{}.start_sigma_rad;
  return config;
}

Report fly(const WorldConfig& config) {
  auto world = SimulatedWorld::create(config);
  Report sent;
  if (!world) {
    sent.why = world.error().message;
    return sent;
  }
  TimeNs last_ns = 0;
  while (!(*world)->ground_done() && (*world)->now() < 300 * ns_per_s) {
    (*world)->step();
    const Pose pose = (*world)->link()->pose(1);
    if (pose.stamp_ns == last_ns || (*world)->link()->phase(1) != LinkPhase::flying) continue;
    last_ns = pose.stamp_ns;
    const auto truth = (*world)->sim().truth(1);
    std::array<double, 2> error{};
    for (std::size_t i = 0; i < 2; ++i) {
      error[i] = pose.position_m[i] - truth.position_m[i];
      const double normalised = error[i] * error[i] / static_cast<double>(pose.variance[i]);
      sent.normalised_squared += normalised;
      sent.inside += normalised < 9 ? 1 : 0;
      ++sent.samples;
    }
    sent.last_error_m = std::hypot(error[0], error[1]);
    sent.last_sigma_m = std::sqrt(static_cast<double>(pose.variance[0] + pose.variance[1]));
    sent.max_error_m = std::max(sent.max_error_m, sent.last_error_m);
  }
  sent.ok = (*world)->ok();
  sent.why = (*world)->why();
  return sent;
}

TEST(OnboardOdometry, ASquareByTheDronesOwnOdometryAndAVarianceThatIsTrue) {
  const int count = seeds(slow ? 1 : 10, 100), laps = slow ? 1 : 3;
  double sum = 0;
  int samples = 0, inside = 0;
  for (int seed = 1; seed <= count; ++seed) {
    const Report sent = fly(square(static_cast<std::uint64_t>(seed), laps, link::PoseSource::tello));
    EXPECT_TRUE(sent.ok) << seed << ": " << sent.why;
    std::printf("seed %d: error at most %.2f m, at the end %.2f m of sigma %.2f m; normalised squared error %.2f\n",
                seed, sent.max_error_m, sent.last_error_m, sent.last_sigma_m, sent.normalised_squared / sent.samples);
    sum += sent.normalised_squared;
    samples += sent.samples;
    inside += sent.inside;
  }
  std::printf("inside three sigmas %.1f %%, normalised squared error %.2f\n", 100.0 * inside / samples, sum / samples);
  if (slow) return;  // statistics want more than a lap
  EXPECT_GE(inside, samples * 95 / 100);
  EXPECT_GT(sum / samples, 0.5);
  EXPECT_LT(sum / samples, 2.0);
}

TEST(OnboardOdometry, WithFourPadsTheErrorStaysSmall) {
  const int count = seeds(slow ? 1 : 5, 100), laps = slow ? 1 : 3;
  for (int seed = 1; seed <= count; ++seed) {
    const Report sent = fly(square(static_cast<std::uint64_t>(seed), laps, link::PoseSource::pads));
    EXPECT_TRUE(sent.ok) << seed << ": " << sent.why;
    std::printf("seed %d, four pads: error at most %.2f m, normalised squared error %.2f\n", seed, sent.max_error_m,
                sent.normalised_squared / sent.samples);
    EXPECT_LT(sent.max_error_m, 0.15) << seed;
  }
}

}  // namespace
}  // namespace ledgerline::hil
