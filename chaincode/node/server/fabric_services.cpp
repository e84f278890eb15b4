#include "chaincode/node/server/calls.hpp"
#include "chaincode/node/server/services.hpp"
#include "chaincode/node/server/streams.hpp"
#include "chaincode/node/shell/block_feed.hpp"
#include "orderer/ab.grpc.pb.h"
#include "peer/events.grpc.pb.h"
#include "peer/peer.grpc.pb.h"

/// The peer's Endorser and Deliver, and the orderer's AtomicBroadcast.
namespace ledgerline::node {
namespace {

/// Fabric's peer.limits.concurrency.endorserService and deliverService; its orderer has no limit, ours has the same.
constexpr int max_peer_calls = 2500;
constexpr std::size_t max_unauthenticated = 256;  // streams of a service of which no member is known yet

class EndorserService final
    : public protos::Endorser::WithRawCallbackMethod_ProcessProposal<protos::Endorser::Service> {
 public:
  EndorserService(Node& node, std::size_t peer) : node_(node), peer_(peer) {}

  grpc::ServerUnaryReactor* ProcessProposal(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                            grpc::ByteBuffer* response) override {
    return answer_on_core<protos::SignedProposal>(
        node_, limits_, context, *request,
        [this](const protos::SignedProposal& proposal) { return node_.priority_of(proposal.SerializeAsString()); },
        [response, peer = peer_](NodeCore& core, const protos::SignedProposal& proposal) {
          const Reply reply = core.process_proposal(proposal.SerializeAsString(), read_now(), peer);
          if (reply.code != Code::ok) return make_status(grpc::StatusCode::UNKNOWN, reply.message);
          *response = to_buffer(reply.bytes);
          return grpc::Status::OK;
        });
  }

 private:
  Node& node_;
  const std::size_t peer_;
  ServiceLimits limits_{"/protos.Endorser", max_peer_calls};
};

template <typename Response>
grpc::ByteBuffer status_message(common::Status status) {
  Response response;
  response.set_status(status);
  return to_buffer(response);
}

/// Shows blocks as `fill` makes them.
template <typename Response>
DeliverStream::View view_of(const BlockFeed& feed, Status (*fill)(std::string_view block, Response& response)) {
  const auto make = [fill](std::string_view block) -> Result<grpc::ByteBuffer> {
    Response response;
    if (Status filled = fill(block, response); !filled) return filled.error();
    return to_buffer(response);
  };
  return {{feed, make}, status_message<Response>};
}

using Blocks = protos::Deliver;
class DeliverService final : public Blocks::WithRawCallbackMethod_Deliver<Blocks::WithRawCallbackMethod_DeliverFiltered<
                                 Blocks::WithRawCallbackMethod_DeliverWithPrivateData<Blocks::Service>>> {
 public:
  DeliverService(Node& node, bool mutual_tls)
      : node_(node),
        mutual_tls_(mutual_tls),
        whole_(view_of(node.feed(), fill_peer)),
        filtered_(view_of(node.feed(), fill_filtered)),
        with_private_data_(view_of(node.feed(), fill_with_private_data)) {}

  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Deliver(grpc::CallbackServerContext* context) override {
    return start(*context, whole_);
  }
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* DeliverFiltered(
      grpc::CallbackServerContext* context) override {
    return start(*context, filtered_);
  }
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* DeliverWithPrivateData(
      grpc::CallbackServerContext* context) override {
    return start(*context, with_private_data_);
  }

 private:
  DeliverStream* start(const grpc::CallbackServerContext& context, DeliverStream::View& view) {
    return DeliverStream::start(node_, limit_, unauthenticated_, view, shown_hash(context, mutual_tls_));
  }

  Node& node_;
  const bool mutual_tls_;
  Limit limit_{"/protos.Deliver", max_peer_calls};
  UnauthenticatedStreams unauthenticated_{max_unauthenticated};
  DeliverStream::View whole_, filtered_, with_private_data_;
};

/// orderer Broadcast: one envelope after the other, acknowledged in order.
class BroadcastStream final
    : public ServedStream<BroadcastStream, grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>> {
 public:
  static BroadcastStream* start(Node& node, Limit& limit, UnauthenticatedStreams& unauthenticated) {
    auto stream = std::make_shared<BroadcastStream>(node, limit, unauthenticated);
    if (admit(stream)) stream->StartRead(&stream->request_);
    return stream.get();
  }
  BroadcastStream(Node& node, Limit& limit, UnauthenticatedStreams& unauthenticated)
      : ServedStream(limit, unauthenticated), node_(node) {}

  void OnReadDone(bool ok) override {
    if (!ok) return finish(grpc::Status::OK);
    on_received();
    common::Envelope envelope;
    if (!parse(request_, envelope)) return finish(unparsable("common.Envelope"));
    const auto order = [self = shared_from_this(), bytes = envelope.SerializeAsString()](NodeCore& core) {
      const Reply reply = core.order(bytes, read_now());
      // What is taken was signed by a member.
      if (reply.code == Code::ok && !self->set_authenticated()) return;
      if (reply.code != Code::ok) self->set_unauthenticated();
      self->acknowledge(reply);
    };
    const bool taken = node_.post(order, Turn::first, node_.sender_of(envelope));
    if (taken) return;
    set_unauthenticated();
    acknowledge({Code::unavailable, "the node has too many requests waiting; try again", {}, {}});
  }
  void OnWriteDone(bool ok) override {
    if (!ok) return finish({grpc::StatusCode::UNAVAILABLE, "the reader is gone"});
    StartRead(&request_);
  }

 private:
  static common::Status status_of(Code code) {
    switch (code) {
      case Code::ok:
        return common::SUCCESS;
      case Code::permission_denied:
        return common::FORBIDDEN;
      case Code::unavailable:
        return common::SERVICE_UNAVAILABLE;
      default:
        return common::BAD_REQUEST;
    }
  }

  void acknowledge(const Reply& reply) {
    const std::lock_guard lock(mutex_);
    if (finished_) return;
    orderer::BroadcastResponse response;
    response.set_status(status_of(reply.code));
    response.set_info(reply.message);
    response_ = to_buffer(response);
    StartWrite(&response_);
  }

  Node& node_;
  grpc::ByteBuffer request_, response_;
};

using Ordering = orderer::AtomicBroadcast;
class OrdererService final
    : public Ordering::WithRawCallbackMethod_Broadcast<Ordering::WithRawCallbackMethod_Deliver<Ordering::Service>> {
 public:
  OrdererService(Node& node, bool mutual_tls)
      : node_(node), mutual_tls_(mutual_tls), ordered_(view_of(node.feed(), fill_orderer)) {}
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Broadcast(grpc::CallbackServerContext*) override {
    return BroadcastStream::start(node_, limit_, unauthenticated_);
  }
  grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>* Deliver(grpc::CallbackServerContext* context) override {
    return DeliverStream::start(node_, limit_, unauthenticated_, ordered_, shown_hash(*context, mutual_tls_));
  }

 private:
  Node& node_;
  const bool mutual_tls_;
  Limit limit_{"/orderer.AtomicBroadcast", max_peer_calls};
  UnauthenticatedStreams unauthenticated_{max_unauthenticated};
  DeliverStream::View ordered_;
};

}  // namespace

std::unique_ptr<grpc::Service> make_endorser_service(Node& node, std::size_t peer) {
  return std::make_unique<EndorserService>(node, peer);
}
std::unique_ptr<grpc::Service> make_deliver_service(Node& node, bool mutual_tls) {
  return std::make_unique<DeliverService>(node, mutual_tls);
}
std::unique_ptr<grpc::Service> make_orderer_service(Node& node, bool mutual_tls) {
  return std::make_unique<OrdererService>(node, mutual_tls);
}

}  // namespace ledgerline::node
