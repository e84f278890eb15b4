#pragma once
#include <spdlog/spdlog.h>

#include <string>

namespace ledgerline {

/// One logger for every program: to standard error, with time, level and the program's name. Standard output is for
/// results. Level from LEDGERLINE_LOG (trace, debug, info, warn, error), else `info`.
void init_log(const std::string& program);

}  // namespace ledgerline
