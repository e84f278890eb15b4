#pragma once
#include <cstdint>
#include <string>

namespace ledgerline::ipc {

/// iceoryx 2.0.3 gives every process a datagram socket under /tmp with its name; RouDi's is called roudi. A socket that
/// refuses a connection belongs to a process that is gone.
enum class Peer : std::uint8_t { alive, gone, forbidden };
Peer probe(const std::string& name);

/// Tells one start of RouDi from the next: the inode of its socket, 0 when there is none.
std::uint64_t socket_inode(const std::string& name);

}  // namespace ledgerline::ipc
