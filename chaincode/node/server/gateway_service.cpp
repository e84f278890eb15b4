#include <map>

#include "chaincode/node/server/calls.hpp"
#include "chaincode/node/server/services.hpp"
#include "chaincode/node/server/streams.hpp"
#include "common/base/text.hpp"
#include "gateway/gateway.grpc.pb.h"

namespace ledgerline::node {
namespace {

/// Fabric's peer.limits.concurrency.gatewayService. Calls that wait have a limit of their own, so that many of them
/// keep nobody from endorsing.
constexpr int max_gateway_calls = 500, max_gateway_waiting = 2500;

/// One CommitStatus call that waits for its transaction. Once the core knows of it, who has the core finishes it.
class CommitWaiter final : public grpc::ServerUnaryReactor {
 public:
  CommitWaiter(Limit::Slot slot, std::function<void()> on_cancel)
      : slot_(std::move(slot)), on_cancel_(std::move(on_cancel)) {}
  void OnCancel() override { on_cancel_(); }
  void OnDone() override { delete this; }

 private:
  Limit::Slot slot_;
  std::function<void()> on_cancel_;
};

using Gateway = gateway::Gateway;
using RawGateway = Gateway::WithRawCallbackMethod_Endorse<Gateway::WithRawCallbackMethod_Submit<
    Gateway::WithRawCallbackMethod_Evaluate<Gateway::WithRawCallbackMethod_CommitStatus<
        Gateway::WithRawCallbackMethod_ChaincodeEvents<Gateway::Service>>>>>;

class GatewayService final : public RawGateway {
 public:
  explicit GatewayService(Node& node)
      : node_(node), events_(node.feed(), EventStream::view_of(node.config().contract)) {
    node.on_answer([this](std::uint64_t waiter, const TxStatus& status) { answer(waiter, status); });
  }

  grpc::ServerUnaryReactor* Evaluate(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                     grpc::ByteBuffer* response) override {
    return answer_on_core<gateway::EvaluateRequest>(
        node_, limits_, context, *request,
        [this](const gateway::EvaluateRequest& call) {
          return Node::TaskPriority{Turn::later,
                                    node_.priority_of(call.proposed_transaction().SerializeAsString()).requester};
        },
        [response](NodeCore& core, const gateway::EvaluateRequest& call) {
          const Reply reply = core.evaluate(call.proposed_transaction().SerializeAsString(), read_now());
          gateway::EvaluateResponse message;
          if (reply.code == Code::ok && !message.mutable_result()->ParseFromString(reply.bytes)) return broken();
          *response = to_buffer(message);
          return make_status(reply);
        });
  }

  grpc::ServerUnaryReactor* Endorse(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                    grpc::ByteBuffer* response) override {
    return answer_on_core<gateway::EndorseRequest>(
        node_, limits_, context, *request,
        [this](const gateway::EndorseRequest& call) {
          return node_.priority_of(call.proposed_transaction().SerializeAsString());
        },
        [response](NodeCore& core, const gateway::EndorseRequest& call) {
          const Reply reply = core.endorse(call.proposed_transaction().SerializeAsString(), read_now());
          gateway::EndorseResponse message;
          if (reply.code == Code::ok && !message.mutable_prepared_transaction()->ParseFromString(reply.bytes)) {
            return broken();
          }
          *response = to_buffer(message);
          return make_status(reply);
        });
  }

  grpc::ServerUnaryReactor* Submit(grpc::CallbackServerContext* context, const grpc::ByteBuffer* request,
                                   grpc::ByteBuffer* response) override {
    *response = to_buffer(gateway::SubmitResponse());
    return answer_on_core<gateway::SubmitRequest>(
        node_, limits_, context, *request,
        [this](const gateway::SubmitRequest& call) {
          return Node::TaskPriority{Turn::first, node_.sender_of(call.prepared_transaction())};
        },
        [](NodeCore& core, const gateway::SubmitRequest& call) {
          const Reply reply = core.order(call.prepared_transaction().SerializeAsString(), read_now());
          switch (reply.code) {
            case Code::ok:
              return grpc::Status::OK;
            case Code::not_found:
              return make_status(grpc::StatusCode::FAILED_PRECONDITION, reply.message);
            case Code::unavailable:
              return make_status(grpc::StatusCode::UNAVAILABLE, reply.message, reply.detail);
            default:
              return make_status(grpc::StatusCode::ABORTED, reply.detail);
          }
        });
  }

  grpc::ServerUnaryReactor* CommitStatus(grpc::CallbackServerContext* context, const grpc::ByteBuffer* bytes,
                                         grpc::ByteBuffer* response) override {
    Limit::Slot slot = waiting_limit_.acquire();
    if (!slot) return refuse(context, too_many(waiting_limit_));
    gateway::SignedCommitStatusRequest signed_request;
    if (!parse(*bytes, signed_request)) return refuse(context, unparsable(signed_request.GetTypeName()));
    gateway::CommitStatusRequest request;
    if (!request.ParseFromString(signed_request.request()))
      return refuse(context, {grpc::StatusCode::INVALID_ARGUMENT, "the status request does not parse"});
    const std::uint64_t id = next_waiter_++;
    const Requester requester = node_.requester_of(request.identity());
    auto* reactor = new CommitWaiter(std::move(slot), [this, id, requester] {
      node_.post_always([this, id](NodeCore& core) { cancel(core, id); }, requester);
    });
    const auto begin_waiting = [this, id, reactor, request, signed_request, response](NodeCore& core) {
      begin(core, id, reactor, request, signed_request, response);
    };
    const bool taken = node_.post(begin_waiting, Turn::first, requester, Node::Stay::briefly);
    if (!taken) reactor->Finish(overloaded());
    return reactor;
  }

  grpc::ServerWriteReactor<grpc::ByteBuffer>* ChaincodeEvents(grpc::CallbackServerContext* /*context*/,
                                                              const grpc::ByteBuffer* request) override {
    return EventStream::start(node_, waiting_limit_, events_, *request);
  }

 private:
  struct Waiting {
    CommitWaiter* reactor;
    grpc::ByteBuffer* response;
    std::string tx_id;
  };

  static grpc::Status broken() { return {grpc::StatusCode::INTERNAL, "the node made an answer that does not parse"}; }

  static grpc::ByteBuffer message_of(const TxStatus& status) {
    gateway::CommitStatusResponse message;
    message.set_result(static_cast<protos::TxValidationCode>(status.code));
    message.set_block_number(status.block);
    return to_buffer(message);
  }

  void begin(NodeCore& core, std::uint64_t id, CommitWaiter* reactor, const gateway::CommitStatusRequest& request,
             const gateway::SignedCommitStatusRequest& signed_request, grpc::ByteBuffer* response) {
    const auto signer =
        core.check_signer(request.identity(), signed_request.request(), signed_request.signature(), read_now());
    if (!signer) return reactor->Finish({grpc::StatusCode::PERMISSION_DENIED, signer.error().message});
    if (request.channel_id() != node_.config().channel) {
      return reactor->Finish(
          {grpc::StatusCode::PERMISSION_DENIED, "channel " + printable(request.channel_id(), max_name) + " not found"});
    }
    if (const auto status = core.watch(request.transaction_id(), id)) {
      *response = message_of(*status);
      return reactor->Finish(grpc::Status::OK);
    }
    waiting_[id] = {reactor, response, request.transaction_id()};
  }

  void answer(std::uint64_t id, const TxStatus& status) {
    const auto found = waiting_.find(id);
    if (found == waiting_.end()) return;
    const Waiting waiting = found->second;
    waiting_.erase(found);
    *waiting.response = message_of(status);
    waiting.reactor->Finish(grpc::Status::OK);
  }

  void cancel(NodeCore& core, std::uint64_t id) {
    const auto found = waiting_.find(id);
    if (found == waiting_.end()) return;
    const Waiting waiting = found->second;
    waiting_.erase(found);
    core.unwatch(waiting.tx_id, id);
    waiting.reactor->Finish(grpc::Status::CANCELLED);
  }

  Node& node_;
  ServiceLimits limits_{"/gateway.Gateway", max_gateway_calls};
  Limit waiting_limit_{"/gateway.Gateway (calls that wait)", max_gateway_waiting};
  ViewCache events_;
  std::atomic<std::uint64_t> next_waiter_{1};
  std::map<std::uint64_t, Waiting> waiting_;  // of who has the core
};

}  // namespace

std::unique_ptr<grpc::Service> make_gateway_service(Node& node) { return std::make_unique<GatewayService>(node); }

}  // namespace ledgerline::node
