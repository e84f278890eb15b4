#pragma once
#include <string>
#include <string_view>

#include "common/base/result.hpp"

namespace ledgerline {

/// Reads a whole file; an error names it.
Result<std::string> read_file(const std::string& path);
/// Rewrites a file, and creates its parent folders; a regular file has its `mode` before it has content. Not synced.
Status write_file(const std::string& path, std::string_view content, int mode = 0644);
/// The same, whole or not at all whatever dies meanwhile, and on the disk when it returns. `path`.new is its own.
Status replace_file(const std::string& path, std::string_view content, int mode = 0644);

}  // namespace ledgerline
