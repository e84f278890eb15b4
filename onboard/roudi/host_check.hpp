#pragma once
#include <sys/types.h>
#include <cstdint>
#include <optional>
#include <string>

#include "common/base/result.hpp"

namespace ledgerline::roudi {

/// The process that holds a lock on this device and inode, by the text of /proc/locks; none: none that is seen.
std::optional<pid_t> lock_holder(const std::string& locks, dev_t device, ino_t inode);

/// Why RouDi cannot serve beside what answers at its socket, and the cure. `answers`: it took a connection, else this
/// user may not ask. `program` is the holder's name, of /proc/PID/comm.
Error in_the_way(bool answers, std::optional<pid_t> holder, const std::string& program);

/// An error where another RouDi has this machine, or has left files that this user cannot take over.
Status check_no_other();

/// Whether a /dev/shm of so many bytes, of which so many are free, has room for RouDi. An error says what to do.
Status check_shared_memory(std::uint64_t size, std::uint64_t available);
/// That of this machine.
Status check_shared_memory();

}  // namespace ledgerline::roudi
