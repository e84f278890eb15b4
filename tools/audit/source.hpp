#pragma once
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "common/base/result.hpp"

/// Where an audit's blocks come from, and go to: files, or a peer.
namespace ledgerline::fabric {
class Client;
struct ClientConfig;
}  // namespace ledgerline::fabric
namespace ledgerline::audit {

/// Gets each block in the chain's order.
using OnBlock = std::function<void(std::string_view block)>;

/// How reading ended, once there was something to read.
struct Reading {
  std::uint64_t blocks = 0;
  std::string problem;  ///< why there is no more; empty: that was all
};

/// A copy of a chain, which is never written to: the file of an embedded node's ledger (DIR/ledger/blocks, or the
/// folder that it is in; the node must not be running), or a folder with one common.Block in each N.block, from 0.block
/// on, as `peer channel fetch` and --save write them. A block that is missing before others, the first too, ends the
/// reading with a problem. An error: there is nothing of the kind.
Result<Reading> read_copy(const std::string& path, const OnBlock& on_block);

/// Writes block `number` into such a folder.
Status save_block(const std::string& folder, std::uint64_t number, std::string_view block);

/// The whole chain as that peer gives it, up to the block that is its newest now. Its blocks are not validated on the
/// way but for their chain, so that the audit finds what is wrong with them. `on_block` is called on this thread. An
/// error: the peer was not reached, or gave no block. Ends, with a problem, when nothing has come for `timeout`.
Result<Reading> read_peer(fabric::ClientConfig config, std::chrono::milliseconds timeout, const OnBlock& on_block);
/// Its first `height` blocks, with a client that validates none.
Result<Reading> read_blocks(fabric::Client& client, std::uint64_t height, std::chrono::milliseconds timeout,
                            const OnBlock& on_block);

}  // namespace ledgerline::audit
