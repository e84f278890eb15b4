#pragma once
#include <grpcpp/support/server_callback.h>

#include <memory>
#include <mutex>

#include "chaincode/node/server/grpc_status.hpp"

namespace ledgerline::node {

/// What the node's streams share: a place under their service's limit, a life that ends when gRPC is done with them,
/// and one end. `Self` is the stream, `Reactor` gRPC's class for its kind.
template <typename Self, typename Reactor>
class ServedStream : public Reactor, public std::enable_shared_from_this<Self> {
 public:
  void OnCancel() override { finish(grpc::Status::CANCELLED); }
  void OnDone() override { self_.reset(); }

 protected:
  /// The limit outlives the stream.
  explicit ServedStream(Limit& limit) : place_(limit.take()) {}

  /// Gives a new stream to gRPC. False: the limit is reached, and the stream has ended with that.
  static bool admit(const std::shared_ptr<Self>& stream, const Limit& limit) {
    stream->self_ = stream;
    if (!stream->place_) stream->finish(too_many(limit));
    return stream->place_ != nullptr;
  }

  void finish(const grpc::Status& status) {
    const std::lock_guard lock(mutex_);
    finish_locked(status);
  }
  /// With the mutex held.
  void finish_locked(const grpc::Status& status) {
    if (finished_) return;
    finished_ = true;
    this->Finish(status);
  }

  std::mutex mutex_;  ///< guards finished_, the start of a write, and what the stream says
  bool finished_ = false;

 private:
  const Limit::Slot place_;
  std::shared_ptr<Self> self_;
};

}  // namespace ledgerline::node
