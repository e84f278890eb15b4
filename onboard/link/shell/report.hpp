#pragma once
#include <array>
#include <optional>
#include <string>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"
#include "onboard/link/core/link_core.hpp"
#include "onboard/link/core/link_io.hpp"
#include "onboard/link/shell/link_loop.hpp"
#include "onboard/link/shell/publisher_thread.hpp"

namespace ledgerline::link {

/// One status line (JSON) from the newest sample of each drone, and what it reported as its serial.
std::string status_line(const LinkSettings& settings, const std::array<StateSample, max_drones + 1>& newest,
                        const std::array<std::optional<SerialReport>, max_drones + 1>& serials);

/// The summary file (JSON); after the loop has ended. `realtime`: the loop got all of what makes it real-time.
Status write_summary(const std::string& path, const LinkCore& core, const LoopMetrics& loop,
                     const PublisherThread& publisher, bool realtime);

}  // namespace ledgerline::link
