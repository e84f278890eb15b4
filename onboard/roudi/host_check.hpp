#pragma once
#include <sys/types.h>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::roudi {

/// The process that holds a lock on this device and inode, by the text of /proc/locks; none: none that is seen.
std::optional<pid_t> lock_holder(const std::string& locks, dev_t device, ino_t inode);

/// Why RouDi cannot serve beside what answers at its socket, and the cure. `answers`: it took a connection, else this
/// user may not ask. `program` is the holder's name, of /proc/PID/comm.
Error in_the_way(bool answers, std::optional<pid_t> holder, const std::string& program);

/// An error where another RouDi has this machine, or has left files that this user cannot take over.
Status check_no_other();

/// The user and the group of a process as iceoryx needs them: it names its memory after the group, and gives it to the
/// group's members.
struct UserGroup {
  uid_t user = 0;
  gid_t group = 0;
  std::string user_name{}, group_name{};  ///< empty: /etc/passwd or /etc/group has no entry
  bool is_member = false;                 ///< the system's entries have the user in the group
  std::vector<std::string> others{};      ///< other users in the group
};
UserGroup group_of_process();
/// Whether iceoryx can serve them. An error says what it cannot take, and what to do.
Status check_group(const UserGroup& of);
/// A warning where other users may write to the memory; empty: nobody else may but root.
std::string warn_of_others(const UserGroup& of);

/// Whether this user may make files in /dev/shm, `mode` its permissions. An error says what to do.
Status check_writable(bool writable, bool read_only, mode_t mode);
/// That of this machine.
Status check_writable();

/// Whether a /dev/shm of so many bytes, of which so many are free, has room for RouDi. An error says what to do.
Status check_shared_memory(std::uint64_t size, std::uint64_t available);
/// That of this machine.
Status check_shared_memory();

}  // namespace ledgerline::roudi
