#pragma once
#include <string>
#include <string_view>

#include "common/rt/result.hpp"

namespace ledgerline {

/// All of a file; the error names it.
Result<std::string> read_file(const std::string& path);
/// Makes the file, and the folders on the way to it, or writes over it; `mode` before anything is in it. Not synced.
Status write_file(const std::string& path, std::string_view content, int mode = 0644);

}  // namespace ledgerline
