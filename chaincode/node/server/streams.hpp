#pragma once
#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "chaincode/node/server/grpc_status.hpp"
#include "chaincode/node/server/proto_bytes.hpp"
#include "chaincode/node/server/served_stream.hpp"
#include "chaincode/node/shell/node.hpp"
#include "chaincode/node/shell/view_cache.hpp"
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

 private:
  void begin(const SeekRange& range);
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
  common::Status written_ = common::UNKNOWN;  // the status being written; UNKNOWN: a block
  bool streaming_ = false, busy_ = false;
};

}  // namespace ledgerline::node
