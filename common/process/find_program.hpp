#pragma once
#include <string>
#include <string_view>

namespace ledgerline {

/// Where in PATH, and then in `also_in` (folders with colons between them), a program of this name is that may be run,
/// as a shell looks for it; empty: nowhere. Any thread that does not change the environment.
std::string find_program(std::string_view name, std::string_view also_in = {});

}  // namespace ledgerline
