#include "chaincode/node/server/streams.hpp"

#include <grpc/grpc_security_constants.h>
#include <grpc/support/time.h>

#include <limits>

#include "chaincode/node/shell/block_feed.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"

namespace ledgerline::node {
namespace {

constexpr TimeNs time_window_ns = 900 * ns_per_s;
constexpr std::uint64_t no_end = std::numeric_limits<std::uint64_t>::max() - 1;

std::uint64_t block_at(const orderer::SeekPosition& position, std::uint64_t height, std::uint64_t otherwise) {
  switch (position.Type_case()) {
    case orderer::SeekPosition::kNewest:
      return height - 1;
    case orderer::SeekPosition::kOldest:
      return 0;
    case orderer::SeekPosition::kSpecified:
      return std::min(position.specified().number(), no_end);
    case orderer::SeekPosition::kNextCommit:
      return height;
    case orderer::SeekPosition::TYPE_NOT_SET:
      break;
  }
  return otherwise;
}

}  // namespace

std::uint64_t read_start(const orderer::SeekPosition& position, std::uint64_t height) {
  return block_at(position, height, height);
}

Result<SeekRange> read_range(const orderer::SeekInfo& seek, std::uint64_t height) {
  if (!seek.has_start() || !seek.has_stop()) return Error{"a seek needs start and stop"};
  SeekRange range;
  range.start = block_at(seek.start(), height, height);
  range.stop = block_at(seek.stop(), height, no_end);
  range.fail_if_not_ready = seek.behavior() == orderer::SeekInfo::FAIL_IF_NOT_READY;
  if (range.start > range.stop) return Error{"the seek's start is behind its stop"};
  return range;
}

Result<SeekRequest> read_seek(const common::Envelope& envelope) {
  SeekRequest request;
  common::Payload payload;
  common::ChannelHeader channel_header;
  common::SignatureHeader signature_header;
  if (!payload.ParseFromString(envelope.payload()) || !payload.has_header() ||
      !channel_header.ParseFromString(payload.header().channel_header()) ||
      !signature_header.ParseFromString(payload.header().signature_header()) ||
      !request.seek.ParseFromString(payload.data())) {
    return Error{"the seek does not parse"};
  }
  request.channel = channel_header.channel_id();
  request.creator = signature_header.creator();
  request.payload = envelope.payload();
  request.signature = envelope.signature();
  request.tls_hash = channel_header.tls_cert_hash();
  // Half of what fits, so that its distance from now can be computed.
  constexpr std::int64_t farthest_s = INT64_MAX / ns_per_s / 2;
  const std::int64_t sent_s = channel_header.timestamp().seconds();
  if (channel_header.has_timestamp() && -farthest_s < sent_s && sent_s < farthest_s) {
    request.sent_ns = channel_header.timestamp().seconds() * ns_per_s;
  }
  return request;
}

bool is_fresh(const SeekRequest& request, TimeNs real_ns) {
  return request.sent_ns && std::abs(*request.sent_ns - real_ns) <= time_window_ns;
}

bool is_bound(const SeekRequest& request, const std::optional<std::string>& shown) {
  return !shown || (!request.tls_hash.empty() && request.tls_hash == *shown);
}

std::optional<std::string> shown_hash(const grpc::CallbackServerContext& context, bool mutual_tls) {
  if (!mutual_tls) return std::nullopt;
  const auto pem = context.auth_context()->FindPropertyValues(GRPC_X509_PEM_CERT_PROPERTY_NAME);
  if (pem.empty()) return std::string();
  const auto hash = crypto::certificate_hash({pem[0].data(), pem[0].size()});
  return hash ? std::string(hash->begin(), hash->end()) : std::string();
}

DeliverStream* DeliverStream::start(Node& node, Limit& limit, UnauthenticatedStreams& unauthenticated, View& view,
                                    std::optional<std::string> shown) {
  auto stream = std::make_shared<DeliverStream>(node, limit, unauthenticated, view, std::move(shown));
  if (admit(stream)) stream->StartRead(&stream->request_);
  return stream.get();
}

void DeliverStream::OnReadDone(bool ok) {
  if (!ok) return finish(grpc::Status::OK);
  on_received();
  common::Envelope envelope;
  if (!parse(request_, envelope)) return finish(unparsable("common.Envelope"));
  const auto request = read_seek(envelope);
  if (!request || !is_fresh(*request, read_now().real_ns) || !is_bound(*request, shown_hash_))
    return send_status(common::BAD_REQUEST);
  if (request->channel != node_.config().channel) return send_status(common::NOT_FOUND);
  const bool taken = node_.post([self = shared_from_this(), request = *request](NodeCore& core) {
    const auto signer = core.check_signer(request.creator, request.payload, request.signature, read_now());
    const auto range = read_range(request.seek, core.height());
    if (!signer) return self->send_status(common::FORBIDDEN);
    if (!range) return self->send_status(common::BAD_REQUEST);
    if (self->set_authenticated()) self->begin(*range, signer->msp_id);
  });
  if (!taken) send_status(common::SERVICE_UNAVAILABLE);
}

void DeliverStream::OnWriteDone(bool ok) {
  if (!ok) return finish({grpc::StatusCode::UNAVAILABLE, "the reader is gone"});
  std::unique_lock lock(mutex_);
  busy_ = false;
  if (written_ == common::UNKNOWN) return pump();
  const bool success = written_ == common::SUCCESS;
  lock.unlock();
  if (!success) return finish(grpc::Status::OK);
  StartRead(&request_);
}

std::string DeliverStream::organisation() const {
  const std::lock_guard lock(mutex_);
  return organisation_;
}

void DeliverStream::wake() {
  const std::lock_guard lock(mutex_);
  pump();
}

void DeliverStream::begin(const SeekRange& range, const std::string& organisation) {
  {
    const std::lock_guard lock(mutex_);
    range_ = range;
    organisation_ = organisation;
    streaming_ = true;
  }
  node_.feed().wake_soon(weak_from_this());
}

/// Sends the next block, or waits for it.
void DeliverStream::pump() {
  if (!streaming_ || busy_ || finished_) return;
  if (range_.start > range_.stop) return write_status(common::SUCCESS);
  if (range_.fail_if_not_ready && range_.start >= node_.feed().height()) return write_status(common::NOT_FOUND);
  if (node_.feed().wait(range_.start, weak_from_this())) return;
  auto block = view_.blocks.read(range_.start);
  if (!block) return write_status(common::INTERNAL_SERVER_ERROR);
  ++range_.start;
  written_ = common::UNKNOWN;
  busy_ = true;
  response_ = std::move(*block);
  StartWrite(&response_);
}

void DeliverStream::send_status(common::Status status) {
  set_unauthenticated();
  const std::lock_guard lock(mutex_);
  write_status(status);
}

void DeliverStream::write_status(common::Status status) {
  streaming_ = false;
  if (finished_ || busy_) return;
  written_ = status;
  busy_ = true;
  response_ = view_.status(status);
  StartWrite(&response_);
}

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
        if (!signer) return stream->finish({grpc::StatusCode::PERMISSION_DENIED, signer.error().message});
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
  const auto start = request.start_position().Type_case();
  if (start == orderer::SeekPosition::kOldest || start == orderer::SeekPosition::kNewest) {
    return finish({grpc::StatusCode::INVALID_ARGUMENT, "invalid start position: give a block's number, or none"});
  }
  const std::lock_guard lock(mutex_);
  // No other contract has events here.
  if (request.chaincode_id() != node_.config().contract) return;
  after_ = request.after_transaction_id();
  const auto behind = core.find(after_);
  next_ = behind ? behind->block : read_start(request.start_position(), core.height());
  streaming_ = true;
  // Looking for the first event may take the whole chain: not by who has the core. The alarm keeps the function, and
  // must not keep us by it.
  to_grpc_thread_.Set(::gpr_inf_past(GPR_CLOCK_REALTIME), [weak = weak_from_this()](bool) {
    if (const auto self = weak.lock()) self->wake();
  });
}

void EventStream::pump() {
  while (streaming_ && !busy_ && !finished_) {
    if (node_.feed().wait(next_, weak_from_this())) return;
    // A checkpoint speaks of the first block alone.
    auto message = after_.empty() ? events_.read(next_)
                                  : ViewCache(node_.feed(), view_of(node_.config().contract, after_)).read(next_);
    if (!message) return finish_locked({grpc::StatusCode::INTERNAL, message.error().message});
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
