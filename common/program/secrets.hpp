#pragma once
#include <cstddef>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline {

/// A file that others may not read (is_private()), of at most `max_bytes`. An error names it and says the cure.
Result<std::string> read_secret_file(const std::string& file, std::size_t max_bytes);
/// The first line of such a file, of at most 4 kB.
Result<std::string> read_secret(const std::string& file);

/// Asks at the terminal, without showing what is typed; where standard input is none: its first line. `prompt`:
/// "Password".
Result<std::string> ask_secret(const std::string& prompt);

}  // namespace ledgerline
