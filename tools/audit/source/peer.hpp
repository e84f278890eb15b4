#pragma once
#include "common/fabric/client/client.hpp"
#include "tools/audit/source/copy.hpp"

/// Where an audit's blocks come from: a peer.
namespace ledgerline::audit {

/// The whole chain as that peer gives it, up to the block that is its newest now. Its blocks are not validated on the
/// way but for their chain, so that the audit finds what is wrong with them. `on_block` is called on this thread. An
/// error: the peer was not reached, or gave no block. Ends, with a problem, when nothing has come for `timeout`.
Result<Reading> read_peer(fabric::ClientConfig config, std::chrono::milliseconds timeout, const OnBlock& on_block);
/// Its first `height` blocks, with a client that validates none.
Result<Reading> read_blocks(fabric::Client& client, std::uint64_t height, std::chrono::milliseconds timeout,
                            const OnBlock& on_block);

}  // namespace ledgerline::audit
