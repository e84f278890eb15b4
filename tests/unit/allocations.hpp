#pragma once
#include <cstdint>

namespace ledgerline {

/// How often this thread has called operator new, which the program that links allocations.cpp replaces.
extern thread_local std::uint64_t allocations;

}  // namespace ledgerline
