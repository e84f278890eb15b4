#pragma once
#include <string>

namespace ledgerline::roudi {

/// The program's work: a Broker until SIGINT or SIGTERM. Says on standard output that it is ready and how many chunks
/// are lost, when that changes; at the end `summary_file` says so, unless it is empty. Ends the process, with its exit
/// code.
[[noreturn]] void serve(const std::string& summary_file);

}  // namespace ledgerline::roudi
