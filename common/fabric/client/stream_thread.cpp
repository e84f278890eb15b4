#include "common/fabric/client/stream_thread.hpp"

#include <fmt/format.h>
#include <pthread.h>

#include <chrono>

#include "common/fabric/client/connection.hpp"
#include "peer/events.grpc.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr TimeNs first_reconnect_ns = 20 * ns_per_ms, max_reconnect_ns = 1 * ns_per_s;

}  // namespace

StreamThread::StreamThread(std::function<std::string(StreamThread&)> follow, OnConnection on_connection)
    : follow_(std::move(follow)),
      on_connection_(std::move(on_connection)),
      back_off_(first_reconnect_ns, max_reconnect_ns),
      thread_([this] { run(); }) {}

StreamThread::~StreamThread() {
  stop();
  thread_.join();
}

void StreamThread::stop() {
  const std::lock_guard lock(mutex_);
  stopping_ = true;
  if (context_ != nullptr) context_->TryCancel();
  wake_.notify_all();
}

void StreamThread::interrupt() {
  const std::lock_guard lock(mutex_);
  if (context_ != nullptr) context_->TryCancel();
}

StreamThread::Cancellable::Cancellable(StreamThread& thread, grpc::ClientContext& context) : follower_(thread) {
  const std::lock_guard lock(follower_.mutex_);
  outer_ = std::exchange(follower_.context_, &context);
  if (follower_.stopping_) context.TryCancel();
}

StreamThread::Cancellable::~Cancellable() {
  const std::lock_guard lock(follower_.mutex_);
  follower_.context_ = outer_;
}

bool StreamThread::stopping() {
  const std::lock_guard lock(mutex_);
  return stopping_;
}

bool StreamThread::pause(TimeNs time_ns) {
  std::unique_lock lock(mutex_);
  return !wake_.wait_for(lock, std::chrono::nanoseconds(time_ns), [this] { return stopping_; });
}

void StreamThread::connected() {
  if (connected_) return;
  connected_ = true;
  last_why_.clear();
  if (on_connection_) on_connection_(true, "");
}

void StreamThread::run() {
  ::pthread_setname_np(::pthread_self(), "stream");
  while (!stopping()) {
    const std::string why = follow_(*this);
    if (stopping()) return;
    const bool news = connected_ || why != last_why_;
    connected_ = false;
    last_why_ = why;
    if (news && on_connection_) on_connection_(false, why);
    (void)pause(back_off_.next(random_));
  }
}

std::string text_of(const grpc::Status& status, const std::string& endpoint) {
  if (status.ok()) return endpoint + " ended the stream";
  if (status.error_code() == grpc::StatusCode::UNAVAILABLE)
    return fmt::format("{}, which is tried again: {}", endpoint, describe(status));
  return fmt::format("{}: {} (gRPC {})", endpoint, describe(status), static_cast<int>(status.error_code()));
}

Result<common::Block> fetch_block(const Connection& connection, StreamThread& thread,
                                  std::optional<std::uint64_t> number) {
  grpc::ClientContext context;
  const StreamThread::Cancellable cancellable(thread, context);
  context.set_deadline(std::chrono::system_clock::now() + connection.config.deadline);
  const std::size_t peer = connection.peer();
  const auto channels = connection.channels();
  const auto stub = protos::Deliver::NewStub(channels->stream_peers[peer]);
  const auto stream = stub->Deliver(&context);
  const std::string& endpoint = connection.endpoint(peer);
  if (const Status sent =
          seek(connection, *stream, endpoint, channels->peer_tls_hashes[peer], number, SeekStop::at_start);
      !sent)
    return sent.error();
  protos::DeliverResponse response;
  const bool read = stream->Read(&response);
  context.TryCancel();
  const grpc::Status status = stream->Finish();
  if (!read || response.Type_case() != protos::DeliverResponse::kBlock ||
      (number && response.block().header().number() != *number))
    return Error{fmt::format("the peer does not give {}: {}",
                             number ? fmt::format("block {}", *number) : "its newest block",
                             text_of(status, endpoint))};
  return std::move(*response.mutable_block());
}

}  // namespace ledgerline::fabric
