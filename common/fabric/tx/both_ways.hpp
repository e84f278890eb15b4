#pragma once
#include <algorithm>
#include <cstdint>

#include "common/rt/clock.hpp"

namespace ledgerline::fabric {

/// How much later a command may come on a channel that cuts its blocks after `timeout_ns` (BatchTimeout) or at
/// `max_messages`: a state comes in one block, and the command that it led to in another. At most 55 s, since limits
/// end at a minute. 0 where each transaction has a block of its own.
inline TimeNs both_ways_ns(TimeNs timeout_ns, std::uint32_t max_messages) {
  constexpr TimeNs max_ns = 55 * ns_per_s;
  return max_messages == 1 ? 0 : std::min(2 * std::min(timeout_ns, max_ns), max_ns);
}

}  // namespace ledgerline::fabric
