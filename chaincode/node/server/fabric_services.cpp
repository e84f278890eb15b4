#include "chaincode/node/server/services.hpp"
#include "chaincode/node/server/streams.hpp"
#include "orderer/ab.grpc.pb.h"
#include "peer/events.grpc.pb.h"
#include "peer/peer.grpc.pb.h"

/// The peer's Endorser and Deliver, and the orderer's AtomicBroadcast.
namespace ledgerline::node {
namespace {

/// Fabric's peer.limits.concurrency.endorserService and deliverService; its orderer has no limit, ours has the same.
constexpr int most_peer_calls = 2500;

class EndorserService final : public protos::Endorser::CallbackService {
 public:
  explicit EndorserService(Node& node) : node_(node) {}

  grpc::ServerUnaryReactor* ProcessProposal(grpc::CallbackServerContext* context, const protos::SignedProposal* request,
                                            protos::ProposalResponse* response) override {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    const Limit::Place place = limit_.take();
    if (!place) {
      reactor->Finish(too_many(limit_));
      return reactor;
    }
    const bool taken = node_.post([request, response, reactor, place](NodeCore& core) {
      const Reply reply = core.process_proposal(request->SerializeAsString(), read_now());
      if (reply.code == Code::ok && !response->ParseFromString(reply.bytes)) {
        return reactor->Finish({grpc::StatusCode::INTERNAL, "the node made an answer that does not parse"});
      }
      reactor->Finish(reply.code == Code::ok ? grpc::Status::OK
                                             : make_status(grpc::StatusCode::UNKNOWN, reply.message));
    });
    if (!taken) reactor->Finish(overloaded());
    return reactor;
  }

 private:
  Node& node_;
  Limit limit_{"/protos.Endorser", most_peer_calls};
};

class DeliverService final : public protos::Deliver::CallbackService {
 public:
  explicit DeliverService(Node& node) : node_(node) {}
  grpc::ServerBidiReactor<common::Envelope, protos::DeliverResponse>* Deliver(grpc::CallbackServerContext*) override {
    return DeliverStream<protos::DeliverResponse>::start(node_, limit_, fill_peer);
  }
  grpc::ServerBidiReactor<common::Envelope, protos::DeliverResponse>* DeliverFiltered(
      grpc::CallbackServerContext*) override {
    return DeliverStream<protos::DeliverResponse>::start(node_, limit_, fill_filtered);
  }

  grpc::ServerBidiReactor<common::Envelope, protos::DeliverResponse>* DeliverWithPrivateData(
      grpc::CallbackServerContext*) override {
    return DeliverStream<protos::DeliverResponse>::start(node_, limit_, fill_with_private_data);
  }

 private:
  Node& node_;
  Limit limit_{"/protos.Deliver", most_peer_calls};
};

/// orderer Broadcast: one envelope after the other, acknowledged in order.
class BroadcastStream final : public grpc::ServerBidiReactor<common::Envelope, orderer::BroadcastResponse>,
                              public std::enable_shared_from_this<BroadcastStream> {
 public:
  static BroadcastStream* start(Node& node, Limit& limit) {
    auto stream = std::make_shared<BroadcastStream>(node, limit);
    stream->self_ = stream;
    if (stream->place_) {
      stream->StartRead(&stream->request_);
    } else {
      stream->finish(too_many(limit));
    }
    return stream.get();
  }
  BroadcastStream(Node& node, Limit& limit) : node_(node), place_(limit.take()) {}

  void OnReadDone(bool ok) override {
    if (!ok) return finish(grpc::Status::OK);
    const bool taken = node_.post([self = shared_from_this()](NodeCore& core) {
      self->acknowledge(core.order(self->request_.SerializeAsString(), read_now()));
    });
    if (!taken) acknowledge({Code::unavailable, "the node has too many requests waiting; try again", {}, {}});
  }
  void OnWriteDone(bool ok) override {
    if (!ok) return finish({grpc::StatusCode::UNAVAILABLE, "the reader is gone"});
    StartRead(&request_);
  }
  void OnCancel() override { finish(grpc::Status::CANCELLED); }
  void OnDone() override { self_.reset(); }

 private:
  static common::Status status_of(Code code) {
    switch (code) {
      case Code::ok:
        return common::SUCCESS;
      case Code::permission_denied:
        return common::FORBIDDEN;
      case Code::not_found:
        return common::NOT_FOUND;
      case Code::unavailable:
        return common::SERVICE_UNAVAILABLE;
      default:
        return common::BAD_REQUEST;
    }
  }

  void acknowledge(const Reply& reply) {
    const std::lock_guard lock(mutex_);
    if (finished_) return;
    response_.set_status(status_of(reply.code));
    response_.set_info(reply.message);
    StartWrite(&response_);
  }

  void finish(const grpc::Status& status) {
    const std::lock_guard lock(mutex_);
    if (finished_) return;
    finished_ = true;
    Finish(status);
  }

  Node& node_;
  const Limit::Place place_;
  common::Envelope request_;
  orderer::BroadcastResponse response_;
  std::shared_ptr<BroadcastStream> self_;  // until gRPC is done with it
  std::mutex mutex_;                       // guards finished_ and the start of a write
  bool finished_ = false;
};

class OrdererService final : public orderer::AtomicBroadcast::CallbackService {
 public:
  explicit OrdererService(Node& node) : node_(node) {}
  grpc::ServerBidiReactor<common::Envelope, orderer::BroadcastResponse>* Broadcast(
      grpc::CallbackServerContext*) override {
    return BroadcastStream::start(node_, limit_);
  }
  grpc::ServerBidiReactor<common::Envelope, orderer::DeliverResponse>* Deliver(grpc::CallbackServerContext*) override {
    return DeliverStream<orderer::DeliverResponse>::start(node_, limit_, fill_orderer);
  }

 private:
  Node& node_;
  Limit limit_{"/orderer.AtomicBroadcast", most_peer_calls};
};

}  // namespace

std::unique_ptr<grpc::Service> make_endorser_service(Node& node) { return std::make_unique<EndorserService>(node); }
std::unique_ptr<grpc::Service> make_deliver_service(Node& node) { return std::make_unique<DeliverService>(node); }
std::unique_ptr<grpc::Service> make_orderer_service(Node& node) { return std::make_unique<OrdererService>(node); }

}  // namespace ledgerline::node
