#pragma once
#include <gtest/gtest.h>

#include "onboard/link/core/failsafe.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {

/// A flight in which all is well, until a test takes something away.
class FailsafeTest : public ::testing::Test {
 protected:
  FailsafeTest() {
    inputs.phase = LinkPhase::flying;
    inputs.flying_since_ns = now;
    inputs.plan_valid = true;
    inputs.ledger_alive = true;
    inputs.position_m = {0, 0, 1};
    inputs.height_m = 1;
    inputs.battery = 0.8F;
  }
  void pass(TimeNs duration) {
    for (const TimeNs end = now + duration; now < end;) {
      now += ms;
      if (heartbeats) inputs.heartbeat_ns = now;
      if (states) inputs.state_ns = now;
      if (poses) inputs.pose_ns = now;
      if (inputs.plan_valid) inputs.covered_until_ns = now + 10 * ms;
      const FailsafeState before = state;
      state = update(settings, fence, state, now, inputs);
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
  FailsafeInputs inputs;
  FailsafeState state;
  TimeNs now = 100 * ns_per_s;
  bool heartbeats = true, states = true, poses = true;
  int changes = 0, causes = 0;  ///< of the mode, of the cause
};

}  // namespace ledgerline::link
