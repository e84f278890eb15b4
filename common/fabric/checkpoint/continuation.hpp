#pragma once
#include <cstdint>
#include <functional>

#include "common/base/result.hpp"
#include "common/fabric/checkpoint/checkpoint.hpp"
#include "common/fabric/tx/transaction.hpp"

namespace common {
class Block;
}

namespace ledgerline::fabric {

/// What a program that starts again knows of the chain.
struct LastVerified {
  Checkpoint last;
  /// So many blocks behind it are read one by one, so that nothing on them is missed; more are left out.
  std::uint64_t max_absence_blocks = 0;
};

/// How a peer's chain goes on behind what was verified.
struct Continuation {
  ChainCheck chain;  ///< its height() is the first block to read
  std::uint64_t verified = 0, newest = 0;
  /// The blocks between them are not read: only the newest one's own signatures say that it is of this chain.
  bool gap = false;
};

/// Whether the peer's chain, whose newest block has that header, can be the one that was verified. Refused, in words:
/// it ends before the checkpoint, or has another block in its place (a fork). Fetches at most the checkpoint's block.
/// Pure.
Result<Continuation> continue_behind(const LastVerified& verified, const common::Block& newest,
                                     const std::function<Result<common::Block>(std::uint64_t number)>& fetch);

}  // namespace ledgerline::fabric
