#pragma once
#include <string>
#include <vector>

namespace ledgerline {

/// What the calling thread and its process got of what was asked for.
struct RealTime {
  bool scheduled = false;            ///< SCHED_FIFO
  bool locked = false;               ///< all memory in RAM
  std::vector<std::string> notices;  ///< what was refused, and what would allow it
  bool all() const { return scheduled && locked; }
};

/// For the calling thread: SCHED_FIFO at `priority` (0: none wanted), pinned to `cpu` (-1: any), memory locked. What is
/// not permitted is a notice, not an error: on a desk the loop runs well enough without.
RealTime enter_real_time(int priority, int cpu);

}  // namespace ledgerline
