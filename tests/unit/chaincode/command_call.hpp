#pragma once
#include <cstdint>

#include "ledgerline.pb.h"

namespace ledgerline {

/// A plan for Org1's tello1, with one setpoint where it flies.
inline CommandCall command_call(std::uint64_t epoch, Action action = FLY) {
  CommandCall call;
  call.set_organisation("Org1MSP");
  DronePlan& plan = *call.add_plans();
  plan.set_drone("tello1");
  plan.set_epoch(epoch);
  plan.set_action(action);
  if (action == FLY) plan.add_setpoints()->set_at_ns(1000);
  return call;
}

}  // namespace ledgerline
