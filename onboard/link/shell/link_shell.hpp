#pragma once
#include "onboard/link/shell/link_config.hpp"

namespace ledgerline::link {

/// The process around the loop: shared memory, sockets, the real-time thread, and in this thread everything that may
/// block: signals, trace file, log, status lines, the summary. Returns the exit code.
int run_link(const ShellSettings& settings);

}  // namespace ledgerline::link
