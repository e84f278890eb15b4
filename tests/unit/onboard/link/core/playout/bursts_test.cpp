#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>
#include <vector>

#include "common/base/random.hpp"
#include "onboard/link/core/playout/playout.hpp"
#include "onboard/link/core/playout/setpoint_path.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

/// Burst smoothing: what flies when commands come a block at a time.
namespace ledgerline::link {
namespace {

constexpr double rate_hz = 30;
constexpr TimeNs way_ns = 20 * ms;  // of a command that waits for no block
constexpr TimeNs begin = 100 * ns_per_s;
constexpr TimeNs warm_up = 20 * ns_per_s, end = 80 * ns_per_s;

struct Flown {
  double spacing_ms = 0;  ///< root mean square of the time between two new setpoints
  double max_ms = 0;
  double jerk_mps3 = 0;  ///< root mean square, of what the drone is sent
  PlanCounters plans;
  TimeNs margin_ns = 0;
};

/// A circle at 1 m/s in 6 s, as a ground 30 times a second commands it that knows how long its commands take on
/// average. Each plan errs a little, for itself. Blocks hold `block` commands. Without smoothing the newest command is
/// flown when it comes, and until the next one comes.
Flown fly(int block, bool smoothing) {
  PlayoutSettings settings;
  if (!smoothing) settings.default_hold_ns = 3 * ns_per_s;
  PlanAdmission admission(settings);
  Playout playout(settings, admission);
  Limiter limiter(settings);
  Random random(1);
  const auto made = [](int k) { return begin + static_cast<TimeNs>(k * 1e9 / rate_hz); };
  const TimeNs delay = way_ns + (made(block - 1) - made(0)) / 2;

  Flown flown;
  double spacing = 0, jerk = 0;
  int spaces = 0, jerks = 0;
  TimeNs last_fresh = 0;
  std::vector<std::array<float, 3>> sent;
  int next = 0;
  for (TimeNs now = begin; now < begin + end; now += ms) {
    while (made(next / block * block + block - 1) + way_ns <= now) {
      Plan plan;
      plan.drone = 1;
      plan.epoch = 1;
      plan.sequence = static_cast<std::uint64_t>(next) + 1;
      plan.state_stamp_ns = made(next) - 10 * ms;
      plan.count = smoothing ? 12 : 1;
      const double error[2] = {0.02 * random.normal(), 0.02 * random.normal()};
      for (std::uint32_t i = 0; i < plan.count; ++i) {
        const TimeNs at = made(next) + delay + static_cast<TimeNs>(i) * 50 * ms;
        const double angle = 2 * std::numbers::pi * to_seconds(at - begin) / 6;
        plan.setpoints[i] = {
            smoothing ? at : now,
            {static_cast<float>(std::cos(angle) + error[0]), static_cast<float>(std::sin(angle) + error[1]), 0},
            0};
      }
      ++next;
      if (admission.admit(now, plan) == DropReason::none) playout.add(now, plan);
    }
    const Playout::CurrentSetpoint setpoint = playout.setpoint(now);
    sent.push_back(limiter.step(now, setpoint.velocity, false).mps);
    if (setpoint.valid && setpoint.fresh) {
      playout.mark_sent();
      if (now - begin > warm_up) {
        spacing += std::pow(to_ms(now - last_fresh), 2);
        flown.max_ms = std::max(flown.max_ms, to_ms(now - last_fresh));
        ++spaces;
      }
      last_fresh = now;
    }
    constexpr std::size_t step = 20;  // ms
    if (now - begin > warm_up) {
      const auto& [a, b, c] =
          std::tie(sent[sent.size() - 1], sent[sent.size() - 1 - step], sent[sent.size() - 1 - 2 * step]);
      for (std::size_t axis : {0, 1}) jerk += std::pow((a[axis] - 2 * b[axis] + c[axis]) / (0.02 * 0.02), 2);
      ++jerks;
    }
  }
  flown.spacing_ms = std::sqrt(spacing / spaces);
  flown.jerk_mps3 = std::sqrt(jerk / jerks);
  flown.margin_ns = playout.margin_ns();
  playout.clear(DropReason::superseded);
  flown.plans = admission.counters();
  return flown;
}

TEST(BurstsTest, BlocksOfManyCommandsFlyAsEvenlyAsSingleOnes) {
  const Flown even = fly(1, true);
  std::printf("block  smoothing  spacing rms, ms  maximum, ms  jerk rms, m/s^3  margin, ms  applied, late, dropped\n");
  const auto print = [](int block, const char* how, const Flown& f) {
    std::printf("%5d  %-9s  %15.1f  %11.0f  %15.1f  %10.0f  %u, %u, %u\n", block, how, f.spacing_ms, f.max_ms,
                f.jerk_mps3, to_ms(f.margin_ns), f.plans.applied, f.plans.late, f.plans.dropped);
  };
  for (const int block : {1, 5, 10, 50}) {
    const Flown with = fly(block, true), without = fly(block, false);
    print(block, "with", with);
    print(block, "without", without);
    EXPECT_LT(with.spacing_ms, 1.2 * even.spacing_ms) << block;
    EXPECT_LT(with.jerk_mps3, 1.2 * even.jerk_mps3) << block;
    EXPECT_EQ(with.plans.dropped_by[static_cast<std::size_t>(DropReason::queue_full)], 0U) << block;
    if (block >= 5) {
      EXPECT_GT(without.spacing_ms, 1.2 * even.spacing_ms) << "the measure sees what smoothing is for";
    }
  }
}

}  // namespace
}  // namespace ledgerline::link
