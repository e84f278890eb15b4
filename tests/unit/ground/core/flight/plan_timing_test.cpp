#include "ground/core/flight/plan_timing.hpp"

#include <gtest/gtest.h>

namespace ledgerline::ground {
namespace {

TEST(PlanTiming, StatesOfADroneSayMoreThanOurOwnCommands) {
  PlanTiming timing(2);
  EXPECT_EQ(timing.of(0).delay_ns, motion::TwoWay::unknown_ns);
  for (int k = 0; k < 20; ++k) timing.measure(100 * ns_per_ms);
  EXPECT_EQ(timing.of(0).delay_ns, 200 * ns_per_ms) << "there and back";
  for (std::uint64_t sequence = 1; sequence <= 8; ++sequence) {
    const TimeNs made_ns = static_cast<TimeNs>(sequence) * ns_per_s;
    timing.submitted(0, sequence, made_ns);
    StateSample state;
    state.arrived_sequence = sequence;
    state.arrived_ns = made_ns + 50 * ns_per_ms;
    timing.observe(0, state);
  }
  EXPECT_EQ(timing.of(0).delay_ns, 50 * ns_per_ms);
  EXPECT_EQ(timing.of(1).delay_ns, 200 * ns_per_ms);
  EXPECT_EQ(timing.max_delay_ns(), 200 * ns_per_ms);
  timing.begin_lease(0);
  EXPECT_EQ(timing.of(0).delay_ns, 200 * ns_per_ms);
}

}  // namespace
}  // namespace ledgerline::ground
