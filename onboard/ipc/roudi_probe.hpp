#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::ipc {

/// iceoryx 2.0.3 gives every process a datagram socket under /tmp with its name; RouDi's is called roudi. A socket that
/// refuses a connection belongs to a process that is gone. One of another user's is forbidden, whether or not it would
/// take our calls: anybody may give a socket this name in /tmp.
enum class Peer : std::uint8_t { alive, gone, forbidden };
Peer probe(const std::string& name);

/// The same where systemd runs RouDi, link and agent: packaging/systemd gives these units a /tmp that is theirs alone.
/// Gone where their shared memory is not this process's, as in a container.
Peer probe_service(const std::string& name);

/// An error where a file of one of these names in /tmp is another user's, or no plain file: iceoryx opens it by name.
Status check_names(const std::vector<std::string>& names);

/// Tells one start of RouDi from the next: the inode of its socket, 0 when there is none.
std::uint64_t socket_inode(const std::string& name);

/// Which of these processes run since before the RouDi that answers beside them: they know one that is gone.
std::vector<std::string> older_than_roudi(const std::vector<std::string>& names);

}  // namespace ledgerline::ipc
