#pragma once
#include <optional>
#include <string>
#include <vector>

#include "tools/timing/figures.hpp"

namespace ledgerline::timing {

/// One thing that must hold:
///   p99.apply=1ms      a quantile (p50, p95, p99, p99.9, max) of a stage, a total or `late`; times in us, ms or s
///   cpu.agent+link=15% programs together, percent of one core
///   overruns=0         of link's loop
///   headroom=50%       what is left of two cores, at least
struct Limit {
  std::string text;
  std::string quantity;               ///< "p99", "cpu", "overruns", "headroom"
  std::string stage;                  ///< of a quantile
  std::vector<std::string> programs;  ///< of cpu
  double bound = 0;                   ///< ms, percent, or a count
};
/// The error names what is not known, and what there is.
Result<Limit> parse_limit(const std::string& text);

struct Verdict {
  std::string limit;
  std::optional<double> measured;  ///< in the bound's unit; none: nothing was measured, which keeps no limit
  bool kept = false;
};
Verdict check(const Limit& limit, const Figures& figures);

}  // namespace ledgerline::timing
