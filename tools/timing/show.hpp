#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tools/timing/figures.hpp"
#include "tools/timing/limits.hpp"

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

}  // namespace ledgerline::timing
