#pragma once
#include <string>

#include "common/base/result.hpp"
#include "common/rt/clock.hpp"
#include "onboard/link/core/settings.hpp"

namespace ledgerline::link {

/// Writes this start into `file` and says how many starts it holds within starts_within_ns, this one counted: at most
/// 64. CLOCK_MONOTONIC, so what was written before the computer was switched on last counts nothing. A file that is
/// missing, torn or somebody else's text counts as none; the error is that it cannot be written, and then nobody
/// remembers this start. Before the real-time loop: it waits for a disk.
Result<int> note_start(const std::string& file, TimeNs now);

}  // namespace ledgerline::link
