#include "common/fabric/client/pipeline.hpp"

#include <fmt/format.h>
#include <grpc/support/time.h>
#include <pthread.h>

#include <algorithm>

#include "peer/proposal.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {
namespace {

/// Nothing is known about a Submit that ended so: it may have been ordered.
bool leaves_open(const grpc::Status& status) {
  switch (status.error_code()) {
    case grpc::StatusCode::UNAVAILABLE:
    case grpc::StatusCode::DEADLINE_EXCEEDED:
    case grpc::StatusCode::CANCELLED:
    case grpc::StatusCode::INTERNAL:
    case grpc::StatusCode::UNKNOWN:
      return true;
    default:
      return false;
  }
}

// A block stream that has not brought a transaction after this may be far behind; the peer is asked then.
constexpr std::chrono::milliseconds stream_timeout{500};

/// The pipeline makes no other requests.
template <typename Pending>
std::shared_ptr<Pending> pending_of(const EndorsementStage::RequestPtr& request) {
  return std::static_pointer_cast<Pending>(request);
}

Outcome in_block(std::uint64_t block, int code) {
  Outcome outcome;
  outcome.kind = code == protos::VALID ? Outcome::Kind::committed : Outcome::Kind::invalidated;
  outcome.block = block;
  outcome.code = code;
  if (code == code_unverified) {
    outcome.message = "flagged valid, but its result cannot be trusted";
  } else if (code != protos::VALID) {
    outcome.message = protos::TxValidationCode_Name(static_cast<protos::TxValidationCode>(code));
  }
  return outcome;
}

}  // namespace

Pipeline::Pipeline(std::shared_ptr<const Connection> connection)
    : connection_(std::move(connection)),
      endorsement_(
          connection_, queue_,
          {.on_endorsed = [this](const auto& request,
                                 const auto& envelope) { on_endorsed(pending_of<Pending>(request), envelope); },
           .on_failed = [this](const auto& request, Outcome::Kind kind,
                               const std::string& why) { finish(pending_of<Pending>(request), kind, why); }}) {
  renew_channels();
  connection_->commits->on_update([this] {
    std::unique_lock lock(mutex_);
    if (!must_wake()) return;
    lock.unlock();
    wake();
  });
  thread_ = std::thread([this] { run(); });
}

Pipeline::~Pipeline() {
  connection_->commits->on_update({});
  {
    std::unique_lock lock(mutex_);
    const bool wakes = must_wake();
    stopping_ = true;
    lock.unlock();
    if (wakes) wake();
  }
  thread_.join();
}

void Pipeline::renew_channels() {
  const GrpcChannels* const channels = endorsement_.renew_channels();
  if (channels == nullptr || channels->orderers.empty()) return;
  if (ordering_)
    ordering_->renew(channels->orderers);
  else
    ordering_.emplace(channels->orderers, queue_);
}

void Pipeline::wake() {
  auto alarm = std::make_shared<grpc::Alarm>();
  // In the past: at once, from this thread. A deadline that is now waits for gRPC's timer, which has milliseconds.
  alarm->Set(&queue_, ::gpr_inf_past(GPR_CLOCK_REALTIME), new QueueTag([this, alarm](bool) { read_inbox(); }));
}

void Pipeline::submit(Call call, std::function<void(Outcome)> done) {
  {
    std::unique_lock lock(mutex_);
    if (!stopping_) {
      inbox_.push_back(
          {std::move(call), std::move(done), std::chrono::system_clock::now() + connection_->config.deadline});
      const bool wakes = must_wake();
      lock.unlock();
      if (wakes) wake();
      return;
    }
  }
  done(Outcome::failed(Outcome::Kind::unavailable, "the client is being closed"));
}

void Pipeline::run() {
  ::pthread_setname_np(::pthread_self(), "submit");
  void* tag = nullptr;
  bool ok = false;
  while (queue_.Next(&tag, &ok)) {
    const std::unique_ptr<QueueTag> then(static_cast<QueueTag*>(tag));
    (*then)(ok);
  }
}

void Pipeline::read_inbox() {
  std::vector<Job> jobs;
  bool stopping = false;
  {
    const std::lock_guard lock(mutex_);
    woken_ = false;
    jobs.swap(inbox_);
    stopping = stopping_;
  }
  for (Job& job : jobs) begin(std::move(job));
  read_commits();
  if (stopping) end_all();
}

void Pipeline::read_commits() {
  const Commits::Update news = connection_->commits->pop_update();
  for (const Commits::Observation& seen : news.seen) {
    const auto found = std::find_if(live_.begin(), live_.end(),
                                    [&](const auto& one) { return one.second->proposal.tx_id == seen.tx_id; });
    if (found == live_.end()) continue;
    const PendingPtr p = found->second;
    if (p->orderer) ordering_->on_committed(*p->orderer, monotonic_ns() - p->sent_ns);
    // Sent twice after a lost acknowledgement: only the peer knows what became of the first one.
    seen.code == protos::DUPLICATE_TXID ? request_status(p) : finish(p, in_block(seen.block, seen.code));
  }
  if (!news.lost) return;
  std::vector<PendingPtr> awaited;
  for (const auto& [number, p] : live_) {
    if (p->awaited) awaited.push_back(p);
  }
  for (const PendingPtr& p : awaited) request_status(p);
}

void Pipeline::begin(Job job) {
  auto p = std::make_shared<Pending>();
  p->number = next_number_++;
  p->call = std::move(job.call);
  p->done = std::move(job.done);
  p->deadline = job.deadline;
  p->begun_ns = monotonic_ns();
  if (live_.size() >= connection_->config.max_in_flight) {
    finish(p, Outcome::Kind::overloaded, fmt::format("{} calls are in flight already", live_.size()));
    return;
  }
  live_.emplace(p->number, p);
  renew_channels();
  p->self = connection_->signing();
  auto proposal = make_proposal(*p->self, connection_->config.where, p->call, realtime_ns(), crypto::random_bytes(24));
  if (!proposal) {
    finish(p, Outcome::Kind::refused, proposal.error().message);
    return;
  }
  p->proposal = std::move(*proposal);
  if (p->call.need) {
    p->need = *p->call.need;
  } else if (const auto& need_of = connection_->config.contract_rules.endorsement_need) {
    p->need = need_of(p->call);
  }
  if (p->need.in_order) order_.push_back(p);
  endorsement_.endorse(p);
}

void Pipeline::on_endorsed(const PendingPtr& p, const Result<std::string>& unsigned_envelope) {
  if (!unsigned_envelope) {
    finish(p, Outcome::Kind::refused, unsigned_envelope.error().message);
    return;
  }
  EventCheck event_check;
  if (const auto& check = connection_->config.contract_rules.event_check; check)
    event_check = [&](std::string_view name, std::string_view payload) { return check(p->call, name, payload); };
  auto prepared = check_prepared(p->proposal, *unsigned_envelope, event_check);
  if (!prepared) {
    finish(p, Outcome::Kind::refused, prepared.error().message);
    return;
  }
  auto envelope = sign_envelope(*p->self, *unsigned_envelope);
  if (!envelope) {
    finish(p, Outcome::Kind::refused, envelope.error().message);
    return;
  }
  p->answer = std::move(*prepared);
  p->envelope = std::move(*envelope);
  p->endorsed_ns = monotonic_ns();
  p->stage = Stage::ready;
  if (!p->need.in_order) {
    const bool busy = !order_.empty() && order_.front()->stage == Stage::sent;
    order_.insert(order_.begin() + (busy ? 1 : 0), p);
  }
  send_next();
}

void Pipeline::send_next() {
  while (!order_.empty() && !(ordering_ && ordering_->busy())) {
    const PendingPtr p = order_.front();
    if (p->stage == Stage::ready) {
      send(p);
      return;
    }
    if (p->stage == Stage::endorsing || p->stage == Stage::sent) return;
    order_.pop_front();
  }
}

void Pipeline::send(const PendingPtr& p) {
  p->stage = Stage::sent;
  p->attempts = {};
  p->awaited = p->call.reported_by_block && connection_->commits->await(p->proposal.tx_id);
  if (ordering_) {
    // Who goes by counts or stamps does not mind a late one.
    const bool may_probe =
        p->call.reported_by_block && std::none_of(live_.begin(), live_.end(), [&](const auto& one) {
          return one.second != p && (one.second->stage == Stage::sent || one.second->stage == Stage::acknowledged);
        });
    p->sent_ns = monotonic_ns();
    ordering_->send(p->envelope, may_probe, p->deadline, [this, p](Ordering::Ended ended, const std::string& why) {
      if (ordering_->which() != p->orderer) p->orderer.reset();
      // Its status may have come before the acknowledgement; the next one has waited for this all the same.
      p->stage == Stage::finished ? send_next() : on_ordered(p, ended, why);
    });
    p->orderer = ordering_->which();
  } else {
    submit_through_gateway(p);
  }
  p->awaited ? await_commit(p) : request_status(p);
}

void Pipeline::on_ordered(const PendingPtr& p, Ordering::Ended ended, const std::string& why) {
  switch (ended) {
    case Ordering::Ended::refused:
      finish(p, Outcome::Kind::refused, "the orderer: " + why);
      return;
    case Ordering::Ended::not_sent:
      submit_through_gateway(p);
      return;
    case Ordering::Ended::open:
      p->submit_problem = "the orderer: " + why;
      break;
    case Ordering::Ended::acknowledged:
      p->ordered_ns = monotonic_ns();
      break;
  }
  p->stage = Stage::acknowledged;
  send_next();
}

void Pipeline::submit_through_gateway(const PendingPtr& p) {
  gateway::SubmitRequest request;
  request.set_transaction_id(p->proposal.tx_id);
  request.set_channel_id(connection_->config.where.channel);
  request.mutable_prepared_transaction()->ParseFromString(p->envelope);
  p->envelope.clear();
  p->submit = std::make_shared<UnaryCall<gateway::SubmitResponse>>(p->deadline);
  p->submit->reader = endorsement_.gateway().AsyncSubmit(&p->submit->context, request, &queue_);
  await(p->submit, [this, p] {
    if (p->stage != Stage::finished) on_submitted(p);
  });
}

void Pipeline::on_submitted(const PendingPtr& p) {
  const grpc::Status& status = p->submit->status;
  if (!status.ok() && !leaves_open(status)) {
    finish(p, Outcome::Kind::refused, describe(status));
    return;
  }
  if (status.ok()) {
    p->ordered_ns = monotonic_ns();
  } else {
    p->submit_problem = describe(status);
  }
  p->stage = Stage::acknowledged;
  send_next();
}

void Pipeline::await_commit(const PendingPtr& p) {
  p->alarm = std::make_shared<grpc::Alarm>();
  p->alarm->Set(&queue_, std::min(p->deadline, std::chrono::system_clock::now() + stream_timeout),
                new QueueTag([this, p](bool ok) {
                  if (ok && p->awaited) request_status(p);
                }));
}

void Pipeline::request_status(const PendingPtr& p) {
  if (p->awaited) connection_->commits->forget(p->proposal.tx_id);
  p->awaited = false;
  const crypto::SigningIdentity& who = *p->self;
  gateway::CommitStatusRequest question;
  question.set_transaction_id(p->proposal.tx_id);
  question.set_channel_id(connection_->config.where.channel);
  question.set_identity(who.serialized);
  gateway::SignedCommitStatusRequest request;
  request.set_request(question.SerializeAsString());
  auto signature = who.signer->sign(request.request());
  if (!signature) {
    finish(p, Outcome::Kind::unavailable, "submitted, but its status is not known: " + signature.error().message);
    return;
  }
  request.set_signature(std::move(*signature));
  p->status = std::make_shared<UnaryCall<gateway::CommitStatusResponse>>(p->deadline);
  p->status->reader = endorsement_.gateway().AsyncCommitStatus(&p->status->context, request, &queue_);
  await(p->status, [this, p] {
    if (p->stage != Stage::finished) on_status(p);
  });
}

void Pipeline::on_status(const PendingPtr& p) {
  const grpc::Status& status = p->status->status;
  if (!status.ok()) {
    const auto again = [this, p] {
      if (p->stage != Stage::finished) request_status(p);
    };
    if (endorsement_.retry(p, status, again)) return;
    std::string why = "submitted, but its status is not known: " + describe(status);
    if (!p->submit_problem.empty()) why += "; Submit: " + p->submit_problem;
    finish(p, Outcome::Kind::unavailable, why);
    return;
  }
  const gateway::CommitStatusResponse& response = p->status->response;
  finish(p, in_block(response.block_number(), response.result()));
}

void Pipeline::finish(const PendingPtr& p, Outcome::Kind kind, const std::string& message) {
  const bool away = kind == Outcome::Kind::unavailable;
  finish(p, Outcome::failed(kind,
                            away ? fmt::format("ledger at {}: {}", connection_->config.endpoint, message) : message));
}

void Pipeline::finish(const PendingPtr& p, Outcome outcome) {
  p->stage = Stage::finished;
  // What is still in flight comes back as cancelled, finds the call finished, and is dropped.
  endorsement_.end(*p, outcome.kind == Outcome::Kind::invalidated);
  if (p->submit) p->submit->context.TryCancel();
  if (p->status) p->status->context.TryCancel();
  if (p->awaited) connection_->commits->forget(p->proposal.tx_id);
  p->awaited = false;
  live_.erase(p->number);
  outcome.tx_id = p->proposal.tx_id;
  outcome.answer = std::move(p->answer);
  outcome.unheard = std::move(p->unheard);
  if (p->ordered_ns != 0) outcome.ordered_after_ns = p->ordered_ns - p->begun_ns;
  outcome.endorsed_ns = p->endorsed_ns;
  outcome.ordered_ns = p->ordered_ns;
  const auto done = std::move(p->done);
  send_next();
  done(std::move(outcome));
}

void Pipeline::end_all() {
  // Nobody's turn comes any more.
  order_.clear();
  while (!live_.empty()) {
    const PendingPtr p = live_.begin()->second;  // finish() takes it out of live_, so a copy holds it
    finish(p, Outcome::Kind::unavailable, "the client is being closed");
  }
  if (ordering_) ordering_->end();
  queue_.Shutdown();
}

}  // namespace ledgerline::fabric
