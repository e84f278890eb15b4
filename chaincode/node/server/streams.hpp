#pragma once
#include <grpcpp/alarm.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "chaincode/node/server/calls.hpp"
#include "chaincode/node/shell/block_feed.hpp"
#include "chaincode/node/shell/node.hpp"
#include "gateway/gateway.pb.h"
#include "orderer/ab.pb.h"

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
  explicit ServedStream(Limit& limit) : limit_(limit), slot_(limit.acquire()) {}
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
    if (!stream->slot_) stream->finish(too_many(stream->limit_));
    return stream->slot_ != nullptr;
  }

  /// Something came, which the core looks at next: nobody displaces it meanwhile.
  void on_received() {
    if (!slot_) unauthenticated_->remove(this);
  }
  /// By who has the core. A member has signed what came: from now on it has a member's place. False as in admit().
  bool set_authenticated() {
    if (!slot_) slot_ = limit_.acquire();
    if (!slot_) finish(too_many(limit_));
    return slot_ != nullptr;
  }
  /// It was not, or nobody looks at it: what comes next may be.
  void set_unauthenticated() {
    if (!slot_) unauthenticated_->add(this->shared_from_this());
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

  mutable std::mutex mutex_;  ///< guards finished_, the start of a write, and what the stream says
  bool finished_ = false;

 private:
  Limit& limit_;
  UnauthenticatedStreams* unauthenticated_ = nullptr;
  Limit::Slot slot_;
  std::shared_ptr<Self> self_;
};

/// The newest blocks as one service shows them: made once, sent to every reader. All methods from any thread.
class ViewCache {
 public:
  using Make = std::function<Result<grpc::ByteBuffer>(std::string_view block)>;
  ViewCache(const BlockFeed& feed, Make make) : feed_(feed), make_(std::move(make)) {}

  Result<grpc::ByteBuffer> read(std::uint64_t number) {
    {
      const std::lock_guard lock(mutex_);
      for (const auto& [known, bytes] : newest_) {
        if (known == number) return bytes;
      }
    }
    const auto block = feed_.read(number);
    if (!block) return block.error();
    auto bytes = make_(**block);
    if (!bytes) return bytes;
    const std::lock_guard lock(mutex_);
    // Old blocks have one reader, who goes on.
    if (number + kept < feed_.height()) return bytes;
    newest_.emplace_front(number, *bytes);
    if (newest_.size() > kept) newest_.pop_back();
    return bytes;
  }

 private:
  static constexpr std::size_t kept = 16;

  const BlockFeed& feed_;
  const Make make_;
  std::mutex mutex_;
  std::deque<std::pair<std::uint64_t, grpc::ByteBuffer>> newest_;
};

// Streams of blocks. Each holds one message and one place in the chain, never a queue: a reader that does not read
// costs nothing but its connection.

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
  std::optional<TimeNs> sent_ns;  ///< real time, by the client's clock
  std::string tls_hash;           ///< of the TLS certificate that the client says it shows
  orderer::SeekInfo seek;
};
Result<SeekRequest> read_seek(const common::Envelope& envelope);
/// One that somebody has kept, or that states no time, is refused (Fabric's authentication.timewindow).
bool is_fresh(const SeekRequest& request, TimeNs real_ns);
/// Under mutual TLS a request names the certificate of its own connection, as in Fabric: who has another one's request
/// reads nothing by it over a connection of his own. `shown`: shown_hash() of the call.
bool is_bound(const SeekRequest& request, const std::optional<std::string>& shown);
/// SHA-256 of the TLS certificate that the client of a call has shown; empty, of which no request is: it cannot be
/// read. nullopt: without mutual TLS, where none is asked for.
std::optional<std::string> shown_hash(const grpc::CallbackServerContext& context, bool mutual_tls);

/// peer Deliver and DeliverFiltered, orderer Deliver. One seek after the other.
class DeliverStream final
    : public ServedStream<DeliverStream, grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>>,
      public BlockFeed::Waiter {
 public:
  /// A service's way to show blocks and statuses. Outlives its streams.
  struct View {
    ViewCache blocks;
    std::function<grpc::ByteBuffer(common::Status)> status;
  };
  /// `shown`: shown_hash() of its call.
  static DeliverStream* start(Node& node, Limit& limit, UnauthenticatedStreams& unauthenticated, View& view,
                              std::optional<std::string> shown);
  DeliverStream(Node& node, Limit& limit, UnauthenticatedStreams& unauthenticated, View& view,
                std::optional<std::string> shown)
      : ServedStream(limit, unauthenticated), node_(node), view_(view), shown_hash_(std::move(shown)) {}

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void wake() override;
  std::string organisation() const override;

 private:
  void begin(const SeekRange& range, const std::string& organisation);
  // With the mutex held:
  void pump();
  void write_status(common::Status status);

  void send_status(common::Status status);

  Node& node_;
  View& view_;
  const std::optional<std::string> shown_hash_;
  grpc::ByteBuffer request_;

  // Guarded by the mutex:
  grpc::ByteBuffer response_;
  SeekRange range_;
  std::string organisation_;
  common::Status written_ = common::UNKNOWN;  // the status being written; UNKNOWN: a block
  bool streaming_ = false, busy_ = false;
};

/// gateway.ChaincodeEvents: a message for each block that has events of the contract.
class EventStream final : public ServedStream<EventStream, grpc::ServerWriteReactor<grpc::ByteBuffer>>,
                          public BlockFeed::Waiter {
 public:
  /// `events`: the contract's events, block by block, as view_of makes them. Limit and cache outlive the stream.
  static EventStream* start(Node& node, Limit& limit, ViewCache& events, const grpc::ByteBuffer& request);
  EventStream(Node& node, Limit& limit, ViewCache& events) : ServedStream(limit), node_(node), events_(events) {}
  /// A block's message; empty when it has no event.
  static ViewCache::Make view_of(const std::string& contract, const std::string& after = {});

  void OnWriteDone(bool ok) override;
  void wake() override;

 private:
  void begin(NodeCore& core, const gateway::ChaincodeEventsRequest& request);
  void pump();

  Node& node_;
  ViewCache& events_;
  grpc::Alarm to_grpc_thread_;

  // Guarded by the mutex:
  grpc::ByteBuffer response_;
  std::string after_;
  std::uint64_t next_ = 0;
  bool streaming_ = false, busy_ = false;
};

}  // namespace ledgerline::node
