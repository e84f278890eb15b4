#pragma once
#include <string>

#include "hil/fault/compare/comparison.hpp"

namespace ledgerline::hil::comparing {

/// A table of what became worse or better, for people; `all`: of all that was tested.
std::string table_text(const Comparison& comparison, const Options& options, bool all);
/// "regression", "improvement", "equal"; "unknown": Comparison::cannot_tell says why.
std::string verdict_of(const Comparison& comparison);
/// Everything, as one JSON object.
std::string json_text(const Comparison& comparison);

}  // namespace ledgerline::hil::comparing
