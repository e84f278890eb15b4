#pragma once
#include <nlohmann/json_fwd.hpp>
#include <ostream>
#include <span>
#include <string>
#include <vector>

#include "tools/timing/figures.hpp"
#include "tools/timing/trace/walks.hpp"

namespace ledgerline::timing {

/// For a terminal. `max_threads`: the busiest ones.
std::string to_table(const Figures& figures, std::size_t max_threads);
std::string to_table(const std::vector<Verdict>& verdicts);
/// Milliseconds, to the microsecond.
nlohmann::json to_json(const Tail& tail);
/// The object of `timing --json`, without what was asked and the machine.
nlohmann::json to_json(const Figures& figures, const std::vector<Verdict>& verdicts);
/// The page, from that object with `asked` and `machine`. Self-contained.
std::string to_page(nlohmann::json document);

/// Chrome's trace events as JSON, which Perfetto opens: a process for each drone, whose walks lie side by side in
/// lanes, each a slice with its stages inside; and link's loop with the worst lateness of every 16 turns. Bounded: the
/// newest `max_walks`. Returns how many walks were left out.
std::size_t write_perfetto(std::ostream& out, std::span<const Walk> walks, std::span<const TraceRecord> loop_turns,
                           std::size_t max_walks = 50'000);

}  // namespace ledgerline::timing
