#pragma once
#include <grpcpp/support/server_callback.h>

#include <functional>
#include <memory>
#include <mutex>

#include "chaincode/node/server/grpc_status.hpp"
#include "chaincode/node/server/node.hpp"
#include "chaincode/node/server/raw.hpp"
#include "chaincode/node/server/view_cache.hpp"
#include "orderer/ab.pb.h"

/// Streams of blocks. Each holds one message and one place in the chain, never a queue: a reader that does not read
/// costs nothing but its connection.
namespace ledgerline::node {

/// Where a seek begins and ends in a chain of `height` blocks.
struct SeekRange {
  std::uint64_t start = 0, stop = 0;
  bool fail_if_not_ready = false;
};
Result<SeekRange> read_range(const orderer::SeekInfo& seek, std::uint64_t height);
/// A start alone: next commit when nothing is said.
std::uint64_t read_start(const orderer::SeekPosition& position, std::uint64_t height);

/// A signed request for blocks, taken apart.
struct SeekRequest {
  std::string channel;
  std::string creator, payload, signature;
  orderer::SeekInfo seek;
};
Result<SeekRequest> read_seek(const common::Envelope& envelope);

/// peer Deliver and DeliverFiltered, orderer Deliver. One seek after the other.
class DeliverStream final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                            public BlockFeed::Waiter,
                            public std::enable_shared_from_this<DeliverStream> {
 public:
  /// A service's way to show blocks and statuses. Outlives its streams.
  struct View {
    ViewCache blocks;
    std::function<grpc::ByteBuffer(common::Status)> status;
  };
  static DeliverStream* start(Node& node, Limit& limit, View& view);
  DeliverStream(Node& node, Limit& limit, View& view) : node_(node), place_(limit.take()), view_(view) {}

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override { finish(grpc::Status::CANCELLED); }
  void OnDone() override { self_.reset(); }
  void wake() override;

 private:
  void begin(const SeekRange& range);
  // With the mutex held:
  void pump();
  void write_status(common::Status status);

  void send_status(common::Status status);
  void finish(const grpc::Status& status);

  Node& node_;
  const Limit::Place place_;
  View& view_;
  grpc::ByteBuffer request_;
  std::shared_ptr<DeliverStream> self_;  // until gRPC is done with it

  std::mutex mutex_;  // guards what follows
  grpc::ByteBuffer response_;
  SeekRange range_;
  common::Status written_ = common::UNKNOWN;  // the status under way; UNKNOWN: a block
  bool streaming_ = false, busy_ = false, finished_ = false;
};

}  // namespace ledgerline::node
