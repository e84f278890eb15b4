#pragma once
#include <string>
#include <string_view>

#include "hil/fault/compare/comparison.hpp"

namespace ledgerline::hil::comparing {

/// Reads what `fault run --json` writes. An error names the file, and which run of it is wrong in what.
Result<Runs> read_results(const std::string& file);
Result<Runs> parse_results(std::string_view json, const std::string& file);

/// A table of what became worse or better, for people; `all`: of all that was tested.
std::string table_text(const Comparison& comparison, const Options& options, bool all);
/// "regression", "improvement", "equal"; "unknown": Comparison::cannot_tell says why.
std::string verdict_of(const Comparison& comparison);
/// Everything, as one JSON object.
std::string json_text(const Comparison& comparison);

}  // namespace ledgerline::hil::comparing
