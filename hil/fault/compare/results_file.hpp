#pragma once
#include <string>
#include <string_view>

#include "hil/fault/compare/comparison.hpp"

namespace ledgerline::hil::comparing {

/// Reads what `fault run --json` writes. An error names the file, and which run of it is wrong in what.
Result<Runs> read_results(const std::string& file);
Result<Runs> parse_results(std::string_view json, const std::string& file);

}  // namespace ledgerline::hil::comparing
