#include "common/fabric/checkpoint/kept_blocks.hpp"

#include <utility>

#include "common/base/log.hpp"
#include "common/fabric/checkpoint/keeper.hpp"

namespace ledgerline::fabric {
namespace {

class KeptBlocks final : public Client::Stream {
 public:
  explicit KeptBlocks(const KeptCheckpoint& kept)
      : channel_(kept.channel), keeper_(kept.path, [channel = kept.channel](const std::string& why) {
          spdlog::error("channel {}: the checkpoint is not kept: {}", channel, why);
        }) {}

  void open(Client& client, std::optional<Checkpoint> last, Client::StreamHandlers handlers) {
    handlers.on_block = [this, hand_over = std::move(handlers.on_block)](const Block& block, std::string_view raw) {
      if (hand_over) hand_over(block, raw);
      if (!block.confirmed) return;
      keeper_.keep({channel_, block.number, block_header_hash(block.number, block.previous_hash, block.data_hash), {}});
    };
    handlers.on_confirmed = [this, tell = std::move(handlers.on_confirmed)](const auto& confirmed) {
      if (tell) tell(confirmed);
      keeper_.keep({channel_, confirmed.number, confirmed.hash, {}});
    };
    if (!last) {
      spdlog::warn("channel {}: there is no checkpoint yet: this start trusts the chain that the peer serves",
                   channel_);
      stream_ = client.blocks(std::nullopt, std::move(handlers));
      return;
    }
    handlers.on_continued = [this, tell = std::move(handlers.on_continued)](const Continuation& how) {
      if (tell) tell(how);
      go_on(how);
    };
    // Any block that came meanwhile makes a gap: the program reads again what it changed.
    stream_ = client.blocks_behind({std::move(*last), 0}, std::move(handlers));
  }

 private:
  void go_on(const Continuation& how) {
    if (!how.gap) return;
    spdlog::warn("channel {}: blocks {} to {} came while this program was away, and are not read", channel_,
                 how.verified + 1, how.newest);
    // Validated already; a program that ends before the next block must not forget it.
    keeper_.keep({channel_, how.newest, how.chain.hash(), {}});
  }

  const std::string channel_;
  CheckpointKeeper keeper_;
  std::unique_ptr<Client::Stream> stream_;  ///< ends first: its callbacks use the above
};

}  // namespace

Result<KeptCheckpoint> KeptCheckpoint::read(const std::string& path, const std::string& channel) {
  auto last = read_checkpoint(path, channel);
  if (!last) return last.error();
  return KeptCheckpoint{path, channel, std::move(*last)};
}

std::unique_ptr<Client::Stream> kept_blocks(Client& client, KeptCheckpoint kept, Client::StreamHandlers handlers) {
  if (kept.path.empty()) return client.blocks(std::nullopt, std::move(handlers));
  auto stream = std::make_unique<KeptBlocks>(kept);
  stream->open(client, std::move(kept.last), std::move(handlers));
  return stream;
}

}  // namespace ledgerline::fabric
