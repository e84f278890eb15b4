#pragma once
#include <string>

#include "common/rt/result.hpp"

namespace ledgerline {

/// All of a file; the error names it.
Result<std::string> read_file(const std::string& path);

}  // namespace ledgerline
