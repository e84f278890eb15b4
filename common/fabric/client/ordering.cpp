#include "common/fabric/client/ordering.hpp"

namespace ledgerline::fabric {
namespace {

// An orderer that does not answer the connection, or an envelope, is passed over after this: one that has just lost its
// leader may hold an envelope for seconds.
constexpr std::chrono::milliseconds connect_limit{500}, answer_limit{500}, probe_limit{100};
constexpr TimeNs first_pause_ns = 10 * ns_per_ms, max_pause_ns = 200 * ns_per_ms;

}  // namespace

Ordering::Ordering(std::vector<std::shared_ptr<grpc::Channel>> orderers, grpc::CompletionQueue& queue)
    : orderers_(std::move(orderers)),
      queue_(queue),
      choice_(orderers_.size()),
      streams_(orderers_.size()),
      back_off_(first_pause_ns, max_pause_ns) {}

Ordering::Tag* Ordering::tag(std::function<void(bool ok)> then) {
  // Stream and alarm are kept until gRPC is done with them, also when they belong to a send that has ended.
  return new Tag([this, number = number_, stream = stream_, pause = pause_, then = std::move(then)](bool ok) {
    if (number == number_ && stream == stream_ && done_) then(ok);
  });
}

void Ordering::send(std::string_view envelope, bool may_probe, std::chrono::system_clock::time_point deadline,
                    Done done) {
  if (!renewed_.empty()) {
    cancel_streams();
    orderers_ = std::exchange(renewed_, {});
  }
  ++number_;
  envelope_.ParseFromArray(envelope.data(), static_cast<int>(envelope.size()));
  deadline_ = deadline;
  done_ = std::move(done);
  sent_ = false;
  which_ = choice_.next(monotonic_ns(), may_probe);
  // No envelope waits for a connection that is made for a probe.
  if (which_ != choice_.best() && orderers_[which_]->GetState(true) != GRPC_CHANNEL_READY) which_ = choice_.best();
  stream_ = streams_[which_];
  limit_ = std::make_shared<grpc::Alarm>();
  limit_->Set(&queue_, deadline_, new Tag([this, number = number_, limit = limit_](bool ok) {
    if (!ok || number != number_ || !done_) return;
    drop_stream();
    pass_on();
    finish(sent_ ? Ended::open : Ended::not_sent, "no acknowledgement in time");
  }));
  if (stream_) return write();
  connect();
}

void Ordering::renew(std::vector<std::shared_ptr<grpc::Channel>> orderers) { renewed_ = std::move(orderers); }

void Ordering::connect() {
  grpc::Channel& channel = *orderers_[which_];
  const grpc_connectivity_state state = channel.GetState(true);
  if (state == GRPC_CHANNEL_READY) {
    stream_ = streams_[which_] = std::make_shared<Stream>();
    auto stub = orderer::AtomicBroadcast::NewStub(orderers_[which_]);
    stream_->io = stub->PrepareAsyncBroadcast(&stream_->context, &queue_);
    stream_->io->StartCall(tag([this](bool ok) { ok ? write() : try_next("the orderer's stream does not start"); }));
    return;
  }
  if (state == GRPC_CHANNEL_TRANSIENT_FAILURE) return try_next("the orderer is not reached");
  const auto until = std::min(deadline_, std::chrono::system_clock::now() + connect_limit);
  channel.NotifyOnStateChange(state, until, &queue_,
                              tag([this](bool ok) { ok ? connect() : try_next("the orderer is not reached"); }));
}

void Ordering::write() {
  sent_ = true;
  silence_ = std::make_shared<grpc::Alarm>();
  const auto limit = which_ == choice_.best() ? answer_limit : probe_limit;
  silence_->Set(&queue_, std::chrono::system_clock::now() + limit, tag([this, silence = silence_](bool ok) {
    if (ok) try_next("no acknowledgement in time");
  }));
  stream_->io->Write(envelope_, tag([this](bool ok) {
                       if (!ok) return try_next("the orderer's stream broke");
                       stream_->io->Read(&stream_->response, tag([this](bool read) { on_acknowledged(read); }));
                     }));
}

void Ordering::on_acknowledged(bool ok) {
  if (!ok) return try_next("the orderer's stream broke");
  const orderer::BroadcastResponse& response = stream_->response;
  switch (response.status()) {
    case common::SUCCESS:
      back_off_.succeeded();
      return finish(Ended::acknowledged, {});
    case common::SERVICE_UNAVAILABLE:  // no leader, or too busy: it was not taken
      return try_next(words_of_peer(response.info()));
    default:
      // Orderers end the stream after a refusal.
      drop_stream();
      return finish(Ended::refused, common::Status_Name(response.status()) + ": " + words_of_peer(response.info()));
  }
}

/// The next orderer, after a pause; the deadline ends it.
void Ordering::try_next(const std::string& why) {
  drop_stream();
  if (silence_) silence_->Cancel();
  if (ended_) return finish(sent_ ? Ended::open : Ended::not_sent, why);
  pass_on();
  pause_ = std::make_shared<grpc::Alarm>();
  pause_->Set(&queue_, std::chrono::system_clock::now() + std::chrono::nanoseconds(back_off_.next(random_)),
              tag([this](bool) { stream_ ? write() : connect(); }));
}

void Ordering::drop_stream() {
  if (stream_) stream_->context.TryCancel();
  stream_.reset();
  streams_[which_].reset();
}

void Ordering::pass_on() {
  const std::size_t best = choice_.best(), next = which_ == best ? (which_ + 1) % orderers_.size() : best;
  choice_.failed(which_, next, monotonic_ns());
  which_ = next;
  stream_ = streams_[which_];
}

void Ordering::finish(Ended ended, const std::string& why) {
  limit_->Cancel();
  if (silence_) silence_->Cancel();
  const Done done = std::exchange(done_, nullptr);
  done(ended, why);
}

void Ordering::cancel_streams() {
  for (auto& stream : streams_) {
    if (stream) stream->context.TryCancel();
    stream.reset();
  }
  stream_.reset();
}

void Ordering::end() {
  ended_ = true;
  cancel_streams();
  if (pause_) pause_->Cancel();
  if (limit_) limit_->Cancel();
  if (silence_) silence_->Cancel();
  done_ = nullptr;
}

}  // namespace ledgerline::fabric
