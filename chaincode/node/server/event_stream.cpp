#include "chaincode/node/server/event_stream.hpp"

#include "chaincode/node/shell/block_view.hpp"
#include "common/base/printable.hpp"

namespace ledgerline::node {

EventStream* EventStream::start(Node& node, Limit& limit, ViewCache& events, const grpc::ByteBuffer& bytes) {
  auto stream = std::make_shared<EventStream>(node, limit, events);
  if (!admit(stream)) return stream.get();
  gateway::SignedChaincodeEventsRequest signed_request;
  if (!parse(bytes, signed_request)) {
    stream->finish(unparsable("gateway.SignedChaincodeEventsRequest"));
    return stream.get();
  }
  gateway::ChaincodeEventsRequest request;
  if (!request.ParseFromString(signed_request.request())) {
    stream->finish({grpc::StatusCode::INVALID_ARGUMENT, "the events request does not parse"});
    return stream.get();
  }
  const bool taken = node.post(
      [stream, request, message = signed_request.request(), signature = signed_request.signature()](NodeCore& core) {
        const auto signer = core.check_signer(request.identity(), message, signature, read_now());
        if (!signer) return stream->finish({grpc::StatusCode::PERMISSION_DENIED, signer.error().what});
        stream->begin(core, request);
      });
  if (!taken) stream->finish(overloaded());
  return stream.get();
}

void EventStream::begin(NodeCore& core, const gateway::ChaincodeEventsRequest& request) {
  if (request.channel_id() != node_.config().channel) {
    return finish(
        {grpc::StatusCode::PERMISSION_DENIED, "channel " + printable(request.channel_id(), max_name) + " not found"});
  }
  const auto place = request.start_position().Type_case();
  if (place == orderer::SeekPosition::kOldest || place == orderer::SeekPosition::kNewest) {
    return finish({grpc::StatusCode::INVALID_ARGUMENT, "invalid start position: give a block's number, or none"});
  }
  const std::lock_guard lock(mutex_);
  // No other contract has events here.
  if (request.chaincode_id() != node_.config().contract) return;
  after_ = request.after_transaction_id();
  const auto behind = core.find(after_);
  next_ = behind ? behind->block : read_start(request.start_position(), core.height());
  streaming_ = true;
  // Looking for the first event may take the whole chain: not on the core's thread. The alarm keeps the function, and
  // must not keep us by it.
  to_grpc_thread_.Set(std::chrono::system_clock::now(), [weak = weak_from_this()](bool) {
    if (const auto self = weak.lock()) self->wake();
  });
}

void EventStream::pump() {
  while (streaming_ && !busy_ && !finished_) {
    if (node_.feed().wait(next_, weak_from_this())) return;
    // A checkpoint speaks of the first block alone.
    auto message = after_.empty() ? events_.read(next_)
                                  : ViewCache(node_.feed(), view_of(node_.config().contract, after_)).read(next_);
    if (!message) return finish_locked({grpc::StatusCode::INTERNAL, message.error().what});
    after_.clear();
    ++next_;
    if (message->Length() == 0) continue;
    busy_ = true;
    response_ = std::move(*message);
    StartWrite(&response_);
  }
}

void EventStream::OnWriteDone(bool ok) {
  if (!ok) return finish({grpc::StatusCode::UNAVAILABLE, "the reader is gone"});
  const std::lock_guard lock(mutex_);
  busy_ = false;
  pump();
}

void EventStream::wake() {
  const std::lock_guard lock(mutex_);
  pump();
}

ViewCache::Make EventStream::view_of(const std::string& contract, const std::string& after) {
  return [=](std::string_view block) -> Result<grpc::ByteBuffer> {
    gateway::ChaincodeEventsResponse response;
    if (Status filled = fill_events(block, contract, after, response); !filled) return filled.error();
    return response.events().empty() ? grpc::ByteBuffer() : to_buffer(response);
  };
}

}  // namespace ledgerline::node
