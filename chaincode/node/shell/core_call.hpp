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

/// A unary call: parsed here, then `work(core, request)` on the core's thread, whose status ends the call.
template <typename Request, typename Work>
grpc::ServerUnaryReactor* answer_on_core(Node& node, Limit& limit, grpc::CallbackServerContext* context,
                                         const grpc::ByteBuffer& bytes, Node::Turn turn, Work work) {
  const Limit::Slot place = limit.take();
  if (!place) return refuse(context, too_many(limit));
  const auto request = std::make_shared<Request>();
  if (!parse(bytes, *request)) return refuse(context, unparsable(request->GetTypeName()));
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  const auto task = [=](NodeCore& core) {
    (void)place;  // held until the task is done
    reactor->Finish(work(core, *request));
  };
  if (!node.post(task, turn)) reactor->Finish(overloaded());
  return reactor;
}

}  // namespace ledgerline::node
