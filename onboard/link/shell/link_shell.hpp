#pragma once
#include <array>
#include <string>

#include "common/base/result.hpp"
#include "onboard/link/core/link_core.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "onboard/link/shell/link_loop.hpp"

namespace ledgerline::link {

/// The process around the loop: shared memory, sockets, the real-time thread, and in this thread everything that may
/// block: signals, trace file, log, status lines, the summary. Returns the exit code.
int run_link(const ShellSettings& settings);

/// One status line (JSON) from the newest sample of each drone.
std::string status_line(const LinkSettings& settings, const std::array<StateSample, max_drones + 1>& newest);

/// Writes the summary at the end of the run.
Status write_summary(const std::string& path, const LinkCore& core, const LoopFigures& loop,
                     const PublisherThread& publisher, bool realtime);

const char* name(DropReason reason) noexcept;

}  // namespace ledgerline::link
