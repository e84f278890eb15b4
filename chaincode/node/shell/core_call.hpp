#pragma once
#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <memory>

#include "chaincode/node/server/grpc_status.hpp"
#include "chaincode/node/server/proto_bytes.hpp"
#include "chaincode/node/shell/node.hpp"

namespace ledgerline::node {

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

/// A unary call: parsed here, then `work(core, request)` on the core's thread, whose status ends the call. `place_of`
/// says of a request when its turn is, and whose it is.
template <typename Request, typename PlaceOf, typename Work>
grpc::ServerUnaryReactor* answer_on_core(Node& node, ServiceLimits& limits, grpc::CallbackServerContext* context,
                                         const grpc::ByteBuffer& bytes, PlaceOf place_of, Work work) {
  Limit::Slot slot = limits.calls.take();
  if (!slot) return refuse(context, too_many(limits.calls));
  const auto request = std::make_shared<Request>();
  if (!parse(bytes, *request)) return refuse(context, unparsable(request->GetTypeName()));
  const Node::Place place = place_of(*request);
  if (place.turn == Node::Turn::later) {
    slot = limits.questions.take();
    if (!slot) return refuse(context, too_many(limits.questions));
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  const auto task = [=](NodeCore& core) {
    (void)slot;  // held until the task is done
    reactor->Finish(work(core, *request));
  };
  if (!node.post(task, place.turn, place.requester)) reactor->Finish(overloaded());
  return reactor;
}

}  // namespace ledgerline::node
