#pragma once
#include <ostream>
#include <span>

#include "tools/timing/trace/walks.hpp"

namespace ledgerline::timing {

/// Chrome's trace events as JSON, which Perfetto opens: a process for each drone, whose walks lie side by side in
/// lanes, each a slice with its stages inside; and link's loop with the worst lateness of every 16 turns. Bounded: the
/// newest `max_walks`. Returns how many walks were left out.
std::size_t write_perfetto(std::ostream& out, std::span<const Walk> walks, std::span<const TraceRecord> loop_turns,
                           std::size_t max_walks = 50'000);

}  // namespace ledgerline::timing
