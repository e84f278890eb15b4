#pragma once
#include <memory>
#include <optional>
#include <string>

#include "common/base/result.hpp"
#include "common/fabric/checkpoint/checkpoint.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::fabric {

/// Where a program keeps the checkpoint of a channel, and what it found there at its start.
struct KeptCheckpoint {
  std::string path;  ///< empty: none is kept
  std::string channel;
  std::optional<Checkpoint> last{};

  /// An error as read_checkpoint() has it: it says what to do, and the program must not start.
  static Result<KeptCheckpoint> read(const std::string& path, const std::string& channel);
};

/// Client::blocks() from the next new one on, for a program that at each start reads everything else that it needs. So
/// only number and hash of its checkpoint count: a chain that ends before it, or has another block in its place, is
/// refused (blocks_behind()); blocks that came while the program was away are not read, which the log says. The newest
/// block handed over that the peer has delivered is kept in the file, beside the stream's thread (CheckpointKeeper),
/// and once more when the stream ends.
std::unique_ptr<Client::Stream> kept_blocks(Client& client, KeptCheckpoint kept, Client::StreamHandlers handlers);

}  // namespace ledgerline::fabric
