#include "ground/core/flight/planner.hpp"

#include <gtest/gtest.h>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

/// A drone that hovers under our lease, and its pilot's planner.
class PlannerByHand : public testing::Test {
 protected:
  PlannerByHand() {
    config.manual = true;
    lease.may_command = true;
    status.phase = GroundPhase::manual;
    seen.has_state = true;
    seen.received_ns = now_ns;
    seen.state.phase = LinkPhase::flying;
    seen.state.boot_id = 7;
    seen.state.stamp_ns = seen.state.pose_stamp_ns = 5 * ns_per_s;
    seen.state.position_m = {1, 2, 1};
    planner.observe(true);
    EXPECT_TRUE(planner.manual().set_velocity(now_ns, Twist{{0.5, 0, 0}, {}}));
  }
  std::optional<CommittedPath> committed() const { return planner.committed(now_ns, {}); }

  const TimeNs now_ns = 1'000 * ns_per_s;
  FlightConfig config = config_for(1);
  Lease lease;
  IntakeState seen;
  FlightStatus status;
  Planner planner{config, 0, lease, seen, status};
};

TEST_F(PlannerByHand, WhatIsSentIsCommittedUntilItIsWithdrawn) {
  EXPECT_FALSE(committed()) << "nothing is sent";
  const auto command = planner.make(now_ns, {});
  ASSERT_TRUE(command);
  const auto path = committed();
  ASSERT_TRUE(path);
  EXPECT_EQ(path->points_m.front(), Eigen::Vector3d(1, 2, 1));
  EXPECT_GT(path->points_m.back().x(), 1.1);
  EXPECT_EQ(path->step_ns, 50 * ns_per_ms);
  planner.withdraw(command->id);
  EXPECT_FALSE(committed());
}

TEST_F(PlannerByHand, OfADroneThatAnotherCommandsNothingIsCommitted) {
  ASSERT_TRUE(planner.make(now_ns, {}));
  ASSERT_TRUE(committed());
  lease.may_command = false;
  EXPECT_FALSE(committed());
}

TEST_F(PlannerByHand, APlanForARestartedHostsLastLifeIsNotCommitted) {
  ASSERT_TRUE(planner.make(now_ns, {}));
  seen.state.boot_id = 8;
  planner.observe(false);
  EXPECT_FALSE(committed());
}

}  // namespace
}  // namespace ledgerline::ground
