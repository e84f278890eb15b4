#pragma once
#include "common/rt/result.hpp"

namespace ledgerline {

/// Puts the calling thread under SCHED_FIFO at `priority` (1 to 98); threads that it starts are ordinary ones again. An
/// error says what would permit it.
Status schedule_fifo(int priority);

}  // namespace ledgerline
