#pragma once
#include <grpcpp/support/server_callback.h>

#include <functional>
#include <memory>
#include <mutex>

#include "chaincode/node/server/block_view.hpp"
#include "chaincode/node/server/grpc_status.hpp"
#include "chaincode/node/server/node.hpp"
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

/// peer Deliver and DeliverFiltered, orderer Deliver: `fill` makes the message of a block. One seek after the other.
template <typename Response>
class DeliverStream final : public grpc::ServerBidiReactor<common::Envelope, Response>,
                            public BlockFeed::Waiter,
                            public std::enable_shared_from_this<DeliverStream<Response>> {
 public:
  using Fill = Status (*)(std::string_view block, Response& response);

  static DeliverStream* start(Node& node, Limit& limit, Fill fill) {
    auto stream = std::make_shared<DeliverStream>(node, limit, fill);
    stream->self_ = stream;
    if (stream->place_) {
      stream->StartRead(&stream->request_);
    } else {
      stream->finish(too_many(limit));
    }
    return stream.get();
  }
  DeliverStream(Node& node, Limit& limit, Fill fill) : node_(node), place_(limit.take()), fill_(fill) {}

  void OnReadDone(bool ok) override {
    if (!ok) return finish(grpc::Status::OK);
    const auto request = read_seek(request_);
    if (!request) return send_status(common::BAD_REQUEST);
    if (request->channel != node_.config().channel) return send_status(common::NOT_FOUND);
    const bool taken = node_.post([self = this->shared_from_this(), request = *request](NodeCore& core) {
      const auto signer = core.check_signer(request.creator, request.payload, request.signature, read_now());
      const auto range = read_range(request.seek, core.height());
      if (!signer) return self->send_status(common::FORBIDDEN);
      if (!range) return self->send_status(common::BAD_REQUEST);
      self->begin(*range);
    });
    if (!taken) send_status(common::SERVICE_UNAVAILABLE);
  }

  void OnWriteDone(bool ok) override {
    if (!ok) return finish({grpc::StatusCode::UNAVAILABLE, "the reader is gone"});
    std::unique_lock lock(mutex_);
    busy_ = false;
    if (response_.Type_case() != Response::kStatus) return pump();
    const bool success = response_.status() == common::SUCCESS;
    lock.unlock();
    if (!success) return finish(grpc::Status::OK);
    this->StartRead(&request_);
  }

  void OnCancel() override { finish(grpc::Status::CANCELLED); }
  void OnDone() override { self_.reset(); }
  void wake() override {
    const std::lock_guard lock(mutex_);
    pump();
  }

 private:
  void begin(const SeekRange& range) {
    const std::lock_guard lock(mutex_);
    range_ = range;
    streaming_ = true;
    pump();
  }

  /// With the mutex held: sends the next block, or waits for it.
  void pump() {
    if (!streaming_ || busy_ || finished_) return;
    if (range_.start > range_.stop) return write_status(common::SUCCESS);
    if (range_.fail_if_not_ready && range_.start >= node_.feed().height()) return write_status(common::NOT_FOUND);
    if (node_.feed().wait(range_.start, this->weak_from_this())) return;
    const auto block = node_.feed().read(range_.start);
    response_.Clear();
    if (!block || !fill_(**block, response_)) return write_status(common::INTERNAL_SERVER_ERROR);
    ++range_.start;
    busy_ = true;
    this->StartWrite(&response_);
  }

  void send_status(common::Status status) {
    const std::lock_guard lock(mutex_);
    write_status(status);
  }

  /// With the mutex held.
  void write_status(common::Status status) {
    streaming_ = false;
    if (finished_ || busy_) return;
    response_.Clear();
    response_.set_status(status);
    busy_ = true;
    this->StartWrite(&response_);
  }

  void finish(const grpc::Status& status) {
    const std::lock_guard lock(mutex_);
    if (finished_) return;
    finished_ = true;
    this->Finish(status);
  }

  Node& node_;
  const Limit::Place place_;
  const Fill fill_;
  common::Envelope request_;
  std::shared_ptr<DeliverStream> self_;  // until gRPC is done with it

  std::mutex mutex_;  // guards what follows
  Response response_;
  SeekRange range_;
  bool streaming_ = false, busy_ = false, finished_ = false;
};

}  // namespace ledgerline::node
