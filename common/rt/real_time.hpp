#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline {

/// What the calling thread and its process got of what was asked for.
struct RealTime {
  bool scheduled = false;            ///< SCHED_FIFO
  bool locked = false;               ///< all memory in RAM
  std::vector<std::string> notices;  ///< what was refused, and what would allow it
  bool all() const { return scheduled && locked; }
};

/// Puts the calling thread under SCHED_FIFO at `priority` (1 to 98); threads that it starts are ordinary ones again. An
/// error says what would permit it.
Status schedule_fifo(int priority);

/// For the calling thread: SCHED_FIFO at `priority` (0: none wanted), pinned to `cpu` (-1: any), memory locked. What is
/// not permitted is a notice, not an error: on a developer's computer the loop runs well enough without.
RealTime enter_real_time(int priority, int cpu);

}  // namespace ledgerline
