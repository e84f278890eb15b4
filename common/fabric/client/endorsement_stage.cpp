#include "common/fabric/client/endorsement_stage.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "peer/proposal.pb.h"

namespace ledgerline::fabric {
namespace {

constexpr std::chrono::milliseconds silent_rest{5'000};  // each try costs the call the timeout with it

EndorsementCollector::Answer answer_of(const std::string& organisation, const grpc::Status& status,
                                       const protos::ProposalResponse& response) {
  if (!status.ok()) return {organisation, describe(status), {}};
  if (response.response().status() >= 400) {
    return {organisation,
            {},
            fmt::format("chaincode response {}, {}", response.response().status(),
                        words_of_peer(response.response().message()))};
  }
  return {organisation, {}, {}, response.payload(), response.SerializeAsString()};
}

/// As if a peer had answered.
grpc::Status read_answer(const OwnEndorser::Answer& answer, protos::ProposalResponse& response) {
  if (!answer.response)
    return {answer.elsewhere ? grpc::StatusCode::UNAVAILABLE : grpc::StatusCode::UNKNOWN,
            answer.response.error().message};
  if (response.ParseFromString(*answer.response)) return grpc::Status::OK;
  return {grpc::StatusCode::INTERNAL, "the own endorser's answer is no response"};
}

protos::SignedProposal message_of(const Proposal& proposal) {
  protos::SignedProposal message;
  message.ParseFromString(proposal.signed_proposal);
  return message;
}

}  // namespace

EndorsementStage::EndorsementStage(std::shared_ptr<const Connection> connection, grpc::CompletionQueue& queue,
                                   Handlers handlers)
    : connection_(std::move(connection)),
      queue_(queue),
      handlers_(std::move(handlers)),
      within_(connection_->channels()->endorsers.size()),
      rest_until_(within_ + 1) {}

const GrpcChannels* EndorsementStage::renew_channels() {
  auto now = connection_->channels();
  if (now == channels_) return nullptr;
  channels_ = std::move(now);
  gateways_.clear();
  peers_.clear();
  endorsers_.clear();
  for (const auto& peer : channels_->peers) {
    gateways_.push_back(gateway::Gateway::NewStub(peer));
    peers_.push_back(protos::Endorser::NewStub(peer));
  }
  for (const auto& endorser : channels_->endorsers) endorsers_.push_back(protos::Endorser::NewStub(endorser));
  return channels_.get();
}

void EndorsementStage::end(EndorsementRequest& request, bool invalidated) {
  request.endorsing = false;
  // It may have read what the peers had replaced already, or may not endorse any more.
  if (invalidated && request.endorser) start_rest(*request.endorser);
  if (request.endorse) request.endorse->context.TryCancel();
  if (request.propose) request.propose->context.TryCancel();
  for (const auto& call : request.proposals) call->context.TryCancel();
  if (request.alarm) request.alarm->Cancel();
}

bool EndorsementStage::retry(const RequestPtr& request, const grpc::Status& status, std::function<void()> again) {
  const auto at = request->attempts.next(status, request->deadline, random_);
  if (!at) return false;
  request->alarm = std::make_shared<grpc::Alarm>();
  request->alarm->Set(&queue_, *at, new QueueTag([request, again = std::move(again)](bool) { again(); }));
  return true;
}

void EndorsementStage::propose_to(const RequestPtr& request, protos::Endorser::Stub& endorser) {
  request->propose = std::make_shared<UnaryCall<protos::ProposalResponse>>(request->deadline);
  // Where another one of its organisation can be asked it is not waited for to the call's end.
  if (request->endorser && has_another(*request->endorser))
    request->propose->context.set_deadline(
        std::min(request->deadline, std::chrono::system_clock::now() + connection_->config.endorse_timeout));
  request->propose->reader =
      endorser.AsyncProcessProposal(&request->propose->context, message_of(request->proposal), &queue_);
  await(request->propose, [this, request] {
    if (request->endorsing) on_proposal_answer(request);
  });
}

bool EndorsementStage::propose_within(const RequestPtr& request) {
  const auto& own = connection_->config.own_endorser;
  if (!own || rests(within_)) return false;
  request->endorser = within_;
  request->propose = std::make_shared<UnaryCall<protos::ProposalResponse>>(request->deadline);
  request->propose->status = read_answer(own->endorse(request->proposal.signed_proposal), request->propose->response);
  on_proposal_answer(request);
  return true;
}

bool EndorsementStage::collect_within(EndorsementRequest& request, const std::string& organisation) {
  const auto& own = connection_->config.own_endorser;
  if (!own || organisation != connection_->config.identity.name.msp_id || rests(within_)) return false;
  const OwnEndorser::Answer answer = own->endorse(request.proposal.signed_proposal);
  if (answer.elsewhere) {
    start_rest(within_);
    return false;
  }
  protos::ProposalResponse response;
  const grpc::Status status = read_answer(answer, response);
  if (status.error_code() == grpc::StatusCode::INTERNAL) return false;
  request.collector->add(answer_of(organisation, status, response));
  return true;
}

std::vector<std::size_t> EndorsementStage::endorsers_now() const {
  return connection_->endorsers_now([&](std::size_t i) { return rests(i); });
}

bool EndorsementStage::has_another(std::size_t endorser) const {
  const auto& all = connection_->config.endorsers;
  return std::any_of(all.begin() + static_cast<std::ptrdiff_t>(endorser) + 1, all.end(),
                     [&](const ClientConfig::Endorser& one) { return one.msp_id == all[endorser].msp_id; });
}

void EndorsementStage::start_rest(std::size_t endorser, std::chrono::milliseconds time) {
  rest_until_[endorser] = std::chrono::system_clock::now() + time;
}

bool EndorsementStage::collect(const RequestPtr& request) {
  const std::vector<std::size_t> chosen = endorsers_now();
  if (chosen.size() < 2) return false;
  const protos::SignedProposal proposal = message_of(request->proposal);
  std::vector<std::string> organisations;
  for (const std::size_t i : chosen) organisations.push_back(connection_->config.endorsers[i].msp_id);
  request->collector.emplace(std::move(organisations), 2,
                             request->need.count == EndorsementNeed::Count::two_if_there_are);
  request->proposals.clear();
  for (const std::size_t i : chosen) {
    const std::string& organisation = connection_->config.endorsers[i].msp_id;
    if (collect_within(*request, organisation)) continue;
    auto call =
        request->proposals.emplace_back(std::make_shared<UnaryCall<protos::ProposalResponse>>(request->deadline));
    call->reader = endorsers_[i]->AsyncProcessProposal(&call->context, proposal, &queue_);
    await(call, [this, request, call, i, &organisation] {
      if (may_pass(call->status)) start_rest(i);
      if (!request->endorsing || !request->collector ||
          std::ranges::find(request->proposals, call) == request->proposals.end())
        return;
      request->collector->add(answer_of(organisation, call->status, call->response));
      on_collected(request, false);
    });
  }
  request->alarm = std::make_shared<grpc::Alarm>();
  request->alarm->Set(
      &queue_, std::min(request->deadline, std::chrono::system_clock::now() + connection_->config.endorse_timeout),
      new QueueTag([this, request](bool ok) {
        if (ok && request->endorsing && request->collector) on_collected(request, true);
      }));
  return true;
}

void EndorsementStage::on_collected(const RequestPtr& request, bool late) {
  const EndorsementCollector::Next next = request->collector->next(late);
  if (next == EndorsementCollector::Next::wait) return;
  if (late && next == EndorsementCollector::Next::unavailable && std::chrono::system_clock::now() < request->deadline)
    return;
  const EndorsementCollector collector = std::move(*request->collector);
  request->collector.reset();
  request->alarm->Cancel();
  for (const auto& call : request->proposals) call->context.TryCancel();
  std::vector<std::string> responses;
  for (const EndorsementCollector::Answer* one : collector.best()) responses.push_back(one->bytes);
  switch (next) {
    case EndorsementCollector::Next::send:
      request->unheard = collector.problem();
      on_endorsed(request, assemble(request->proposal, responses));
      return;
    case EndorsementCollector::Next::refused:
      handlers_.on_failed(request, Outcome::Kind::refused, collector.problem());
      return;
    case EndorsementCollector::Next::again:
      on_not_endorsed(request, {grpc::StatusCode::UNAVAILABLE, "the peers' answers differ"});
      return;
    default:
      on_not_endorsed(request,
                      {grpc::StatusCode::UNAVAILABLE, "no second organisation endorses: " + collector.problem()});
  }
}

void EndorsementStage::endorse(const RequestPtr& request) {
  using Count = EndorsementNeed::Count;
  const ClientConfig& config = connection_->config;
  const EndorsementNeed& need = request->need;
  const bool direct = !config.orderers.empty();
  if (direct && need.count == Count::one) {
    const bool own = need.organisation.empty();
    const std::string& organisation = own ? config.identity.name.msp_id : need.organisation;
    request->endorser.reset();
    if (organisation == config.identity.name.msp_id && propose_within(request)) return;
    for (const std::size_t i : endorsers_now()) {
      const bool there = channels_->endorsers[i]->GetState(true) != GRPC_CHANNEL_TRANSIENT_FAILURE && !rests(i);
      if (config.endorsers[i].msp_id != organisation || (!there && own)) continue;
      request->endorser = i;
      return propose_to(request, *endorsers_[i]);
    }
    if (own) return propose_to(request, *peers_[connection_->peer()]);
  }
  if (direct && need.count != Count::one && collect(request)) return;
  gateway::EndorseRequest message;
  if (need.count == Count::one && !need.organisation.empty()) message.add_endorsing_organizations(need.organisation);
  message.set_transaction_id(request->proposal.tx_id);
  message.set_channel_id(config.where.channel);
  *message.mutable_proposed_transaction() = message_of(request->proposal);
  request->endorse = std::make_shared<UnaryCall<gateway::EndorseResponse>>(request->deadline);
  request->endorse->reader = gateway().AsyncEndorse(&request->endorse->context, message, &queue_);
  await(request->endorse, [this, request] {
    if (request->endorsing) on_gateway_answer(request);
  });
}

void EndorsementStage::on_gateway_answer(const RequestPtr& request) {
  const grpc::Status& status = request->endorse->status;
  if (!status.ok() && request->need.count == EndorsementNeed::Count::two_if_there_are &&
      status.error_code() != grpc::StatusCode::ABORTED && std::chrono::system_clock::now() < request->deadline) {
    request->unheard = describe(status);
    request->need.count = EndorsementNeed::Count::one;
    return propose_to(request, *peers_[connection_->peer()]);
  }
  if (!status.ok()) return on_not_endorsed(request, status);
  on_endorsed(request, request->endorse->response.prepared_transaction().SerializeAsString());
}

void EndorsementStage::on_proposal_answer(const RequestPtr& request) {
  if (!request->propose->status.ok()) return on_not_endorsed(request, request->propose->status);
  on_endorsed(request, assemble(request->proposal, {request->propose->response.SerializeAsString()}));
}

void EndorsementStage::on_endorsed(const RequestPtr& request, const Result<std::string>& unsigned_envelope) {
  request->endorsing = false;
  handlers_.on_endorsed(request, unsigned_envelope);
}

void EndorsementStage::on_not_endorsed(const RequestPtr& request, const grpc::Status& status) {
  const bool silent = status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED &&
                      std::chrono::system_clock::now() < request->deadline;
  if (const auto endorser = std::exchange(request->endorser, std::nullopt); endorser && (may_pass(status) || silent)) {
    const bool rested = rests(*endorser);
    start_rest(*endorser, silent ? silent_rest : rest);
    if (!rested || silent) return endorse(request);  // at once, of another one: at most once while it rests
  }
  const auto again = [this, request] {
    if (request->endorsing) endorse(request);
  };
  if (retry(request, status, again)) return;
  handlers_.on_failed(request, is_away(status) ? Outcome::Kind::unavailable : Outcome::Kind::refused, describe(status));
}

}  // namespace ledgerline::fabric
