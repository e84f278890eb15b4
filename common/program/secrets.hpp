#pragma once
#include <string>

#include "common/base/result.hpp"

namespace ledgerline {

/// The first line of a file that others may not read (is_private()), of at most 4 kB. An error names it and says the
/// cure.
Result<std::string> read_secret(const std::string& file);

/// Asks at the terminal, without showing what is typed; where standard input is none: its first line. `prompt`:
/// "Password".
Result<std::string> ask_secret(const std::string& prompt);

}  // namespace ledgerline
