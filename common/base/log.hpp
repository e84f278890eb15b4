#pragma once
#include <spdlog/spdlog.h>

#include <string>

namespace ledgerline {

/// One logger for every program: to standard error, with time, level and the program's name. Standard output is for
/// results. Level from LEDGERLINE_LOG (trace, debug, info, warn, error), else `info`.
void init_log(const std::string& program);

/// Behind init_log(), for a program that runs until it is asked to end: from now on no thread waits for who reads the
/// log (log/log_ring.hpp). A process that leaves by _exit() calls spdlog::default_logger()->flush() before, and one
/// that forks does so before this call.
void log_without_waiting();

}  // namespace ledgerline
