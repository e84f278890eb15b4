#pragma once
#include <grpcpp/support/server_callback.h>

#include <memory>
#include <mutex>

#include "chaincode/node/server/grpc_status.hpp"

namespace ledgerline::node {

/// What the node's streams share: a place under their service's limit, a life that ends when gRPC is done with them,
/// and one end. `Self` is the stream, `Reactor` gRPC's class for its kind.
template <typename Self, typename Reactor>
class ServedStream : public Reactor, public UnauthenticatedStreams::Stream, public std::enable_shared_from_this<Self> {
 public:
  void OnCancel() override { finish(grpc::Status::CANCELLED); }
  void OnDone() override {
    if (unauthenticated_ != nullptr) unauthenticated_->remove(this);
    self_.reset();
  }
  void displace() override {
    finish({grpc::StatusCode::RESOURCE_EXHAUSTED, "too many streams of which nobody knows whose they are"});
  }

 protected:
  /// It has its place at once. The limit outlives the stream.
  explicit ServedStream(Limit& limit) : limit_(limit), place_(limit.take()) {}
  /// It has a place once its member is known. Both outlive the stream.
  ServedStream(Limit& limit, UnauthenticatedStreams& unauthenticated)
      : limit_(limit), unauthenticated_(&unauthenticated) {}

  /// Gives a new stream to gRPC. False: the limit is reached, and the stream has ended with that.
  static bool admit(const std::shared_ptr<Self>& stream) {
    stream->self_ = stream;
    if (stream->unauthenticated_ != nullptr) {
      stream->unauthenticated_->add(stream);
      return true;
    }
    if (!stream->place_) stream->finish(too_many(stream->limit_));
    return stream->place_ != nullptr;
  }

  /// Something came, which the core looks at next: nobody displaces it meanwhile.
  void is_looked_at() {
    if (!place_) unauthenticated_->remove(this);
  }
  /// On the core thread. A member has signed what came: from now on it has a member's place. False as in admit().
  bool is_of_member() {
    if (!place_) place_ = limit_.take();
    if (!place_) finish(too_many(limit_));
    return place_ != nullptr;
  }
  /// It was not, or nobody looks at it: what comes next may be.
  void is_of_nobody() {
    if (!place_) unauthenticated_->add(this->shared_from_this());
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
  Limit& limit_;
  UnauthenticatedStreams* unauthenticated_ = nullptr;
  Limit::Slot place_;
  std::shared_ptr<Self> self_;
};

}  // namespace ledgerline::node
