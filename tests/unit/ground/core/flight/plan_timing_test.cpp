#include "ground/core/flight/plan_timing.hpp"

#include <gtest/gtest.h>

namespace ledgerline::ground {
namespace {

TEST(PlanTiming, StatesOfADroneSayMoreThanOurOwnCommands) {
  PlanTiming timing(2);
  EXPECT_EQ(timing.of(0).delay_ns, RoundTripEstimate::unknown_ns);
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

/// Plans of one drone that come `spacing_ns` apart, each `way_ns` behind its making.
void come(PlanTiming& timing, int count, TimeNs spacing_ns, TimeNs way_ns) {
  for (int k = 1; k <= count; ++k) {
    const TimeNs made_ns = 10 * ns_per_s + k * spacing_ns;
    timing.submitted(0, static_cast<std::uint64_t>(k), made_ns);
    StateSample state;
    state.arrived_sequence = static_cast<std::uint64_t>(k);
    state.arrived_ns = made_ns + way_ns;
    timing.observe(0, state);
  }
}

// A ledger that cuts a block each second: eight plans would come only after link has landed the drone.
TEST(PlanTiming, PlansThatComeSeldomCountByTime) {
  PlanTiming timing(1);
  come(timing, 2, ns_per_s, ns_per_s);
  EXPECT_EQ(timing.of(0).delay_ns, RoundTripEstimate::unknown_ns) << "one second says too little";
  come(timing, 3, ns_per_s, ns_per_s);
  EXPECT_EQ(timing.of(0).delay_ns, ns_per_s);
}

TEST(PlanTiming, APlanLastsUntilTheNextOne) {
  PlanTiming often(1), seldom(1);
  come(often, 20, 100 * ns_per_ms, 300 * ns_per_ms);
  EXPECT_EQ(often.of(0).steps, PathController::steps);
  come(seldom, 20, ns_per_s, 300 * ns_per_ms);
  EXPECT_GE(static_cast<TimeNs>(seldom.of(0).steps) * PathController::step_ns, ns_per_s);
}

TEST(PlanTiming, ALedgerThatIsTooSlowForAnyPlanIsReported) {
  PlanTiming timing(1);
  EXPECT_TRUE(timing.check_delay()) << "nobody knows yet";
  timing.measure(1'900 * ns_per_ms);
  EXPECT_TRUE(timing.check_delay());
  for (int k = 0; k < 10; ++k) timing.measure(2'300 * ns_per_ms);
  const Status checked = timing.check_delay();
  ASSERT_FALSE(checked);
  EXPECT_NE(checked.error().message.find("take 4.6 s"), std::string::npos) << checked.error().message;
}

}  // namespace
}  // namespace ledgerline::ground
