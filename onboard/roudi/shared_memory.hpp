#pragma once
#include <cstdint>

#include "common/base/result.hpp"

namespace ledgerline::roudi {

/// Whether a /dev/shm of so many bytes, of which so many are free, has room for RouDi. An error says what to do.
Status check_shared_memory(std::uint64_t size, std::uint64_t available);
/// That of this machine.
Status check_shared_memory();

}  // namespace ledgerline::roudi
