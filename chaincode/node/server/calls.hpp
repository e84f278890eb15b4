#pragma once
#include <google/protobuf/message_lite.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>
#include <grpcpp/support/status.h>

#include <memory>
#include <string>

#include "chaincode/node/core/types.hpp"
#include "chaincode/node/server/limit.hpp"
#include "chaincode/node/shell/node.hpp"

namespace ledgerline::node {

/// With a gateway.ErrorDetail (address, MSP id, `detail`) as Fabric's gateway attaches it; none when `detail` is empty.
grpc::Status make_status(grpc::StatusCode code, const std::string& message, const std::string& detail = {});
grpc::Status make_status(const Reply& reply);
/// The queue to the core is full.
grpc::Status overloaded();
/// As many calls of this service are open as may be.
inline grpc::Status too_many(const Limit& limit) { return {grpc::StatusCode::RESOURCE_EXHAUSTED, limit.refusal()}; }

// Messages come and go as bytes: what does not parse is refused in Fabric's words (gRPC's own C++ refusal has none),
// and a block that many read is written out once.

inline bool parse(const grpc::ByteBuffer& buffer, google::protobuf::MessageLite& message) {
  grpc::Slice bytes;
  return buffer.DumpToSingleSlice(&bytes).ok() && message.ParseFromArray(bytes.begin(), static_cast<int>(bytes.size()));
}

inline grpc::ByteBuffer to_buffer(const google::protobuf::MessageLite& message) {
  grpc::Slice bytes(message.ByteSizeLong());
  message.SerializeWithCachedSizesToArray(const_cast<std::uint8_t*>(bytes.begin()));
  return {&bytes, 1};
}

inline grpc::ByteBuffer to_buffer(const std::string& message) {
  const grpc::Slice bytes(message);
  return {&bytes, 1};
}

inline grpc::Status unparsable(const std::string& type) {
  return {grpc::StatusCode::INTERNAL, "grpc: error unmarshalling request: it is no " + type};
}

/// Instead of another use of the context's reactor.
inline grpc::ServerUnaryReactor* refuse(grpc::CallbackServerContext* context, const grpc::Status& status) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(status);
  return reactor;
}

/// How many calls of a service may be open. Questions have a limit of their own, so that they take no place of
/// commands'.
struct ServiceLimits {
  ServiceLimits(const std::string& service, int max_open) : calls(service, max_open), questions(service, max_open) {}
  Limit calls, questions;
};

/// A unary call: parsed here, then `work(core, request)` by who has the core, whose status ends the call.
/// `priority_of` says of a request when its turn is, and whose it is.
template <typename Request, typename PriorityOf, typename Work>
grpc::ServerUnaryReactor* answer_on_core(Node& node, ServiceLimits& limits, grpc::CallbackServerContext* context,
                                         const grpc::ByteBuffer& bytes, PriorityOf priority_of, Work work) {
  Limit::Slot slot = limits.calls.acquire();
  if (!slot) return refuse(context, too_many(limits.calls));
  const auto request = std::make_shared<Request>();
  if (!parse(bytes, *request)) return refuse(context, unparsable(request->GetTypeName()));
  const Node::TaskPriority priority = priority_of(*request);
  if (priority.turn == Turn::later) {
    slot = limits.questions.acquire();
    if (!slot) return refuse(context, too_many(limits.questions));
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  const auto task = [=](NodeCore& core) {
    (void)slot;  // held until the task is done
    reactor->Finish(work(core, *request));
  };
  // The answer of a unary call leaves when this returns.
  if (!node.post(task, priority.turn, priority.requester, Node::Stay::briefly)) reactor->Finish(overloaded());
  return reactor;
}

}  // namespace ledgerline::node
