#pragma once
#include <gtest/gtest.h>

#include "onboard/link/core/failsafe.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {

/// A flight in which all is well, until a test takes something away.
class FailsafeTest : public ::testing::Test {
 protected:
  FailsafeTest() {
    facts.phase = FlightPhase::flying;
    facts.flying_since_ns = now;
    facts.plan_valid = true;
    facts.ledger_alive = true;
    facts.position_m = {0, 0, 1};
    facts.height_m = 1;
    facts.battery = 0.8F;
  }
  void pass(TimeNs duration) {
    for (const TimeNs end = now + duration; now < end;) {
      now += ms;
      if (heartbeats) facts.heartbeat_ns = now;
      if (states) facts.state_ns = now;
      if (poses) facts.pose_ns = now;
      if (facts.plan_valid) facts.covered_until_ns = now + 10 * ms;
      const FailsafeState before = state;
      state = update(settings, fence, state, now, facts);
      if (state.mode != before.mode) ++changes;
      if (state.cause != before.cause) ++causes;
    }
  }
  void expect(FailsafeMode mode, FailsafeCause cause) const {
    EXPECT_EQ(state.mode, mode);
    EXPECT_EQ(state.cause, cause);
  }

  FailsafeSettings settings;
  FenceSettings fence;
  FailsafeFacts facts;
  FailsafeState state;
  TimeNs now = 100 * ns_per_s;
  bool heartbeats = true, states = true, poses = true;
  int changes = 0, causes = 0;  ///< of the mode, of the cause
};

}  // namespace ledgerline::link
