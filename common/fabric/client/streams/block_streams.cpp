#include <utility>

#include "common/fabric/client/streams/block_readers.hpp"
#include "common/fabric/client/streams/follower.hpp"

namespace ledgerline::fabric {
namespace {

BlockIntake make_intake(const Connection& connection, std::optional<std::uint64_t> start) {
  const ClientConfig& config = connection.config;
  BlockIntake intake = std::move(BlockIntake::make({.where = config.where,
                                                    .config_block = config.config_block,
                                                    .make_registry = BlockValidator::registry_of(config.verifier),
                                                    .likely_policy = config.likely_policy,
                                                    .is_of_hot_path = config.is_of_hot_path,
                                                    .real_time = realtime_ns,
                                                    .source = config.blocks}))
                           .value();  // make_connection has tried it
  if (start) intake.start_at(*start);
  return intake;
}

/// The own peer's stream and, where it is read, an orderer's; both run until this is gone.
class BlockStreams final : public Client::Stream {
 public:
  BlockStreams(const std::shared_ptr<const Connection>& connection, BlocksFrom from, Client::StreamHandlers handlers) {
    auto on_connection = handlers.on_connection;
    auto on_orderers = handlers.on_orderers;
    auto on_continued = handlers.on_continued;
    const auto blocks = std::make_shared<BlockHandOver>(make_intake(*connection, from.number), connection->commits,
                                                        std::move(handlers));
    const auto reader =
        std::make_shared<BlockReader>(connection, std::move(from.verified), blocks, std::move(on_continued));
    if (!connection->channels()->stream_orderers.empty()) {
      ordered_ = run_follower(std::make_shared<OrderedReader>(connection, blocks), std::move(on_orderers));
      reader->interrupt_ordered_by([this] { ordered_->interrupt(); });
    }
    peers_ = run_follower(reader, std::move(on_connection));
  }
  ~BlockStreams() override {
    // One may wait for the other, which waits for a peer.
    peers_->stop();
    if (ordered_) ordered_->stop();
  }
  BlockStreams(const BlockStreams&) = delete;
  BlockStreams& operator=(const BlockStreams&) = delete;

 private:
  std::unique_ptr<Follower> ordered_;
  std::unique_ptr<Follower> peers_;  ///< ends first: it interrupts the other
};

}  // namespace

std::unique_ptr<Client::Stream> follow_blocks(const std::shared_ptr<const Connection>& connection, BlocksFrom from,
                                              Client::StreamHandlers handlers) {
  return std::make_unique<BlockStreams>(connection, std::move(from), std::move(handlers));
}

}  // namespace ledgerline::fabric
