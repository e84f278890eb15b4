#pragma once
#include <gtest/gtest.h>

#include <initializer_list>
#include <string>

#include "common/rt/clock.hpp"
#include "onboard/ipc/ipc.hpp"

/// For tests of the real ledgerline-link that stand in for agent. The poses are made up: 3 m apart, so that nobody is
/// in another's way, and each stands still.
namespace ledgerline::ipc {

inline void heartbeat_and_pose(AgentEnd& agent, AgentHeartbeat heartbeat, DroneNumber drones) {
  heartbeat.stamp_ns = monotonic_ns();
  heartbeat.ledger_alive = true;
  (void)agent.send_heartbeat(heartbeat);
  for (DroneNumber drone = 1; drone <= drones; ++drone) {
    (void)agent.send_pose({.drone = drone,
                           .stamp_ns = heartbeat.stamp_ns,
                           .position_m = {3.0 * drone, 0, 1},
                           .velocity_mps = {},
                           .yaw_rad = 0});
  }
}

template <typename States>
void take_states(AgentEnd& agent, States& newest) {
  for (StateSample sample; agent.receive_state(sample);) newest[sample.drone] = sample;
}

/// A main whose arguments are the paths of these programs; the last `optional` of them may be missing.
inline int run_with_programs(int argc, char** argv, std::initializer_list<std::string*> programs, int optional = 0) {
  ::testing::InitGoogleTest(&argc, argv);
  if (argc - 1 < static_cast<int>(programs.size()) - optional) return 2;
  int i = 1;
  for (std::string* program : programs) {
    if (i < argc) *program = argv[i++];
  }
  return RUN_ALL_TESTS();
}

}  // namespace ledgerline::ipc
