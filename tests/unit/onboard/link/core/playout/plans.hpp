#pragma once
#include "common/msg/onboard.hpp"
#include "tests/unit/onboard/link/core/times.hpp"

namespace ledgerline::link {

/// A plan of `count` setpoints 50 ms apart from `at`, flying x at `speed`.
inline Plan plan_of(std::uint64_t sequence, TimeNs at, std::uint32_t count, float speed, TimeNs stamp) {
  Plan plan;
  plan.drone = 1;
  plan.epoch = 1;
  plan.sequence = sequence;
  plan.state_stamp_ns = stamp;
  plan.count = count;
  for (std::uint32_t i = 0; i < count; ++i) plan.setpoints[i] = {at + i * 50 * ms, {speed, 0, 0}, 0};
  return plan;
}

}  // namespace ledgerline::link
