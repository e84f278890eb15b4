#include "ground/core/flight/phases.hpp"

#include <gtest/gtest.h>

#include "tests/unit/ground/core/flight_world.hpp"

namespace ledgerline::ground {
namespace {

/// One drone under our lease: its phases and its planner.
class PhasesTest : public testing::Test {
 protected:
  PhasesTest() {
    lease.holder = lease.commander = operator_name;
    lease.may_command = true;
    seen.has_state = true;
    seen.state.phase = LinkPhase::on_ground;
    seen.state.pose_stamp_ns = 1;
    phases.begin(0);
  }

  const FlightConfig config = config_for(1);
  Lease lease;
  IntakeState seen;
  FlightStatus status;
  Planner planner{config, 0, lease, seen, status};
  PlanTiming timing{1};
  Phases phases{config, lease, seen, timing, planner, status};
};

TEST_F(PhasesTest, OnTheGroundUnderOurLeaseItTakesOffAndSaysSoInAPlan) {
  EXPECT_FALSE(planner.make(0, {})) << "nothing to say while it waits";
  phases.advance(0, 0);
  EXPECT_EQ(status.phase, GroundPhase::takeoff);
  const auto command = planner.make(0, {});
  ASSERT_TRUE(command);
  EXPECT_EQ(command->plan.action(), TAKEOFF);
  EXPECT_EQ(command->plan.drone(), "tello1");
  seen.state.phase = LinkPhase::taking_off;
  EXPECT_FALSE(planner.make(0, {})) << "it does already";
}

TEST_F(PhasesTest, ALostLeaseFailsAStopLands) {
  phases.advance(0, 0);
  *lease.stoppers.add_stoppers() = stop_of("tello1", outsider_name);
  phases.lease_changed(0);
  EXPECT_EQ(status.phase, GroundPhase::landing);
  lease.may_command = false;
  EXPECT_FALSE(planner.make(0, {})) << "others land it";
}

TEST_F(PhasesTest, ALeaseThatIsAnothersEndsTheFlight) {
  phases.advance(0, 0);
  lease.holder = lease.commander = outsider_name;
  phases.lease_changed(0);
  EXPECT_EQ(status.phase, GroundPhase::failed);
  EXPECT_EQ(status.why, "lost its lease to CN=User1@org3");
}

TEST_F(PhasesTest, ALeaseThatWeHoldAndAnotherCommandsEndsTheFlight) {
  phases.advance(0, 0);
  lease.commander = outsider_name;
  phases.lease_changed(0);
  EXPECT_EQ(status.phase, GroundPhase::failed);
  EXPECT_EQ(status.why, "lost its lease to CN=User1@org2, who lets CN=User1@org3 command it");
}

TEST_F(PhasesTest, AnotherHolderWhoLetsUsCommandLeavesTheFlightAlone) {
  phases.advance(0, 0);
  lease.holder = outsider_name;
  phases.lease_changed(0);
  EXPECT_EQ(status.phase, GroundPhase::takeoff);
  EXPECT_EQ(status.why, "");
}

TEST_F(PhasesTest, SilenceLandsItAndALandingThatNobodySeesFails) {
  phases.advance(0, 0);
  phases.check_time(config.limits.silence_ns + 1);
  EXPECT_EQ(status.phase, GroundPhase::landing);
  phases.check_time(config.limits.silence_ns + config.limits.landing_ns + 2);
  EXPECT_EQ(status.phase, GroundPhase::failed);
}

TEST_F(PhasesTest, APilotsTakeOffIsRefusedOnAPath) {
  const Status taken = phases.take_off(0, false);
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().message, "it flies a path");
}

}  // namespace
}  // namespace ledgerline::ground
