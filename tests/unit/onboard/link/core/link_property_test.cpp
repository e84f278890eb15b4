#include <gtest/gtest.h>

#include <cmath>

#include "common/base/random.hpp"
#include "tests/unit/campaign.hpp"
#include "tests/unit/onboard/link/core/link_world.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

/// What must hold for any plans at all, in any order, at any time: seeded, so that a failure can be repeated.
namespace ledgerline::link {
namespace {

float random_speed(Random& random) {
  switch (random.next() % 8) {
    case 0:
      return std::numeric_limits<float>::quiet_NaN();
    case 1:
      return 1e30F;
    case 2:
      return 0;
    default:
      return static_cast<float>(8 * random.uniform() - 4);
  }
}

// Most plans are good; the rest are spoilt in every field that a program may get wrong.
void add_random_plan(Random& random, LinkWorld& w) {
  const bool spoilt = random.next() % 4 == 0;
  Plan& plan = w.fly_plan({0, 0, 0}, static_cast<std::uint32_t>(1 + random.next() % 12),
                          static_cast<TimeNs>(random.next() % 200) * ms - 100 * ms);
  for (std::uint32_t i = 0; i < plan.count; ++i) {
    for (float& v : plan.setpoints[i].velocity_mps)
      v = spoilt ? random_speed(random) : static_cast<float>(8 * random.uniform() - 4);
    plan.setpoints[i].yaw_rate_radps = static_cast<float>(6 * random.uniform() - 3);
  }
  plan.state_stamp_ns = w.now - static_cast<TimeNs>(random.next() % 100) * ms;
  if (!spoilt) return;
  switch (random.next() % 6) {
    case 0:
      plan.sequence = random.next() % (w.sequence + 5);
      break;
    case 1:
      plan.epoch = random.next() % 2;
      break;
    case 2:
      plan.count = static_cast<std::uint32_t>(random.next());
      break;
    case 3:
      plan.state_stamp_ns = static_cast<TimeNs>(random.next());
      break;
    case 4:
      plan.setpoints[random.next() % max_setpoints].at_ns = static_cast<TimeNs>(random.next());
      break;
    default:
      plan.action = static_cast<PlanAction>(random.next() % 8 == 0 ? 200 : 0);
      break;
  }
}

class AnyPlans : public ::testing::TestWithParam<int> {};

TEST_P(AnyPlans, NeverAboveTheLimitsAndEveryPlanCounted) {
  Random random(static_cast<std::uint64_t>(GetParam()));
  LinkSettings settings;
  settings.fence.min_m = {-1e3, -1e3, 0};
  settings.fence.max_m = {1e3, 1e3, 1e3};
  LinkWorld w(1, settings);
  w.take_off();
  for (int i = 0; i < 300; ++i) {
    for (std::uint64_t burst = random.next() % 3; burst > 0; --burst) add_random_plan(random, w);
    w.pass(static_cast<TimeNs>(1 + random.next() % 60) * ms);
  }
  // Acceleration: between any two rc, no more than the limit allows, plus rc's rounding.
  std::array<int, 4> last{};
  TimeNs last_at = 0;
  for (const auto& [at, text] : w.sent) {
    std::array<int, 4> rc{};
    if (std::sscanf(text.c_str(), "rc %d %d %d %d", &rc[0], &rc[1], &rc[2], &rc[3]) != 4) continue;
    for (const int channel : rc) ASSERT_LE(std::abs(channel), 100);
    ASSERT_LE(std::abs(rc[2]), 100 * settings.playout.max_vertical_mps);
    if (last_at != 0) {
      const double dt = to_seconds(at - last_at);
      const double change = std::hypot(rc[0] - last[0], rc[1] - last[1], rc[2] - last[2]) / 100;
      // rc's range shortens a vector, which may move what is sent by as much again as the limiter moves.
      ASSERT_LE(change, 4 * settings.playout.max_acceleration_mps2 * dt + 0.02) << text << " after " << dt;
    }
    last = rc;
    last_at = at;
  }
  w.pass(3 * ns_per_s);
  w.core.finish();
  const PlanCounters c = w.core.reports()[0].plans;
  EXPECT_EQ(c.received, c.applied + c.late + c.dropped);
  EXPECT_GT(c.applied, 50U);
  std::uint32_t applied = 0;
  for (const TraceRecord& record : w.trace) applied += record.kind == TraceKind::command_applied;
  EXPECT_EQ(applied, c.applied);
  for (const StateSample& state : w.states) {
    EXPECT_LE(std::hypot(state.sent_velocity_mps[0], state.sent_velocity_mps[1]),
              settings.playout.max_speed_mps + 1e-4);
  }
}

TEST_P(AnyPlans, SilenceAlwaysEndsInZeroThenLanding) {
  Random random(1000 + static_cast<std::uint64_t>(GetParam()));
  LinkWorld w;
  w.take_off();
  for (int i = 0; i < 60; ++i) {
    for (std::uint64_t burst = random.next() % 4; burst > 0; --burst) add_random_plan(random, w);
    w.pass(static_cast<TimeNs>(1 + random.next() % 40) * ms);
  }
  // Silence of one kind or another, at a random moment.
  w.agent = random.next() % 2 == 0;
  w.ledger = random.next() % 2 == 0;
  w.mocap = random.next() % 2 == 0;
  w.pass(4 * ns_per_s);  // the maximum duration of a queued plan, and the ramp
  if (w.core.phase(1) == LinkPhase::flying) {
    EXPECT_TRUE(w.tellos[0].keeps_place());
  }
  w.pass(w.settings_.failsafe.land_after_ns + 20 * ns_per_s);
  EXPECT_EQ(w.tellos[0].motion, FakeTello::Motion::ground);
  EXPECT_TRUE(w.core.all_on_ground());
}

TEST_P(AnyPlans, TheSameSeedGivesTheSameBytes) {
  const auto run = [&] {
    Random random(2000 + static_cast<std::uint64_t>(GetParam()));
    LinkWorld w(2);
    w.take_off();
    for (int i = 0; i < 50; ++i) {
      add_random_plan(random, w);
      w.pass(20 * ms);
    }
    return w.sent;
  };
  EXPECT_EQ(run(), run());
}

INSTANTIATE_TEST_SUITE_P(Seeds, AnyPlans, ::testing::Range(0, seeds(12, 5000)));

}  // namespace
}  // namespace ledgerline::link
