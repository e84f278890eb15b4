#include <fmt/format.h>

#include <algorithm>

#include "common/fabric/client/client.hpp"
#include "common/fabric/client/pipeline.hpp"
#include "peer/proposal.pb.h"

/// The pipeline's first stage: who endorses a call.
namespace ledgerline::fabric {
namespace {

constexpr std::chrono::milliseconds silent_rest{5'000};  // each try costs the call the timeout with it

bool not_reached(const grpc::Status& status) {
  return may_pass(status) || status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED ||
         status.error_code() == grpc::StatusCode::CANCELLED;
}

Gathering::Answer answer_of(const std::string& organisation, const grpc::Status& status,
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

grpc::Status status_of(const OwnEndorser::Answer& answer) {
  return {answer.elsewhere ? grpc::StatusCode::UNAVAILABLE : grpc::StatusCode::UNKNOWN, answer.problem};
}

}  // namespace

void Pipeline::propose_to(const PendingPtr& p, protos::Endorser::Stub& endorser) {
  protos::SignedProposal proposal;
  proposal.ParseFromString(p->proposal.signed_proposal);
  p->propose = make_unary<protos::ProposalResponse>(p);
  // Where another one of its organisation can be asked it is not waited for to the call's end.
  if (p->endorser && has_another(*p->endorser))
    p->propose->context.set_deadline(
        std::min(p->deadline, std::chrono::system_clock::now() + connection_->config.endorse_timeout));
  p->propose->reader = endorser.AsyncProcessProposal(&p->propose->context, proposal, &queue_);
  await(p, p->propose, &Pipeline::on_proposed);
}

bool Pipeline::propose_within(const PendingPtr& p) {
  const auto& own = connection_->config.own_endorser;
  if (!own || std::chrono::system_clock::now() < rest_until_[within_]) return false;
  p->endorser = within_;
  p->propose = make_unary<protos::ProposalResponse>(p);
  const OwnEndorser::Answer answer = own->endorse(p->proposal.signed_proposal);
  if (!answer.problem.empty()) {
    p->propose->status = status_of(answer);
  } else if (!p->propose->response.ParseFromString(answer.response)) {
    p->propose->status = {grpc::StatusCode::INTERNAL, "the own endorser's answer is no response"};
  }
  on_proposed(p);
  return true;
}

bool Pipeline::gather_within(const PendingPtr& p, const std::string& organisation) {
  const auto& own = connection_->config.own_endorser;
  if (!own || organisation != connection_->config.identity.name.msp_id ||
      std::chrono::system_clock::now() < rest_until_[within_])
    return false;
  const OwnEndorser::Answer answer = own->endorse(p->proposal.signed_proposal);
  if (answer.elsewhere) {
    let_rest(within_);
    return false;
  }
  protos::ProposalResponse response;
  if (answer.problem.empty() && !response.ParseFromString(answer.response)) return false;
  const grpc::Status status = answer.problem.empty() ? grpc::Status::OK : status_of(answer);
  p->gathering->take(answer_of(organisation, status, response));
  return true;
}

std::vector<std::size_t> Pipeline::endorsers_now() const {
  const Time now = std::chrono::system_clock::now();
  return connection_->endorsers_now([&](std::size_t i) { return now < rest_until_[i]; });
}

bool Pipeline::has_another(std::size_t endorser) const {
  const auto& all = connection_->config.endorsers;
  return std::any_of(all.begin() + static_cast<std::ptrdiff_t>(endorser) + 1, all.end(),
                     [&](const ClientConfig::Endorser& one) { return one.msp_id == all[endorser].msp_id; });
}

void Pipeline::let_rest(std::size_t endorser, std::chrono::milliseconds time) {
  rest_until_[endorser] = std::chrono::system_clock::now() + time;
}

bool Pipeline::gather(const PendingPtr& p) {
  const std::vector<std::size_t> chosen = endorsers_now();
  if (chosen.size() < 2) return false;
  protos::SignedProposal proposal;
  proposal.ParseFromString(p->proposal.signed_proposal);
  std::vector<std::string> organisations;
  for (const std::size_t i : chosen) organisations.push_back(connection_->config.endorsers[i].msp_id);
  p->gathering.emplace(std::move(organisations), 2, p->need.count == EndorsementNeed::Count::two_if_there_are);
  p->asked.clear();
  for (const std::size_t i : chosen) {
    if (gather_within(p, connection_->config.endorsers[i].msp_id)) continue;
    auto unary = make_unary<protos::ProposalResponse>(p);
    p->asked.push_back(unary);
    unary->reader = endorsers_[i]->AsyncProcessProposal(&unary->context, proposal, &queue_);
    const std::string& organisation = connection_->config.endorsers[i].msp_id;
    unary->reader->Finish(&unary->response, &unary->status, new Tag([this, p, unary, i, &organisation](bool) {
      if (may_pass(unary->status)) let_rest(i);
      if (p->stage != Stage::endorsing || !p->gathering || std::ranges::find(p->asked, unary) == p->asked.end()) return;
      p->gathering->take(answer_of(organisation, unary->status, unary->response));
      on_gathered(p, false);
    }));
  }
  p->alarm = std::make_shared<grpc::Alarm>();
  p->alarm->Set(&queue_, std::min(p->deadline, std::chrono::system_clock::now() + connection_->config.endorse_timeout),
                new Tag([this, p](bool ok) {
                  if (ok && p->stage == Stage::endorsing && p->gathering) on_gathered(p, true);
                }));
  return true;
}

void Pipeline::on_gathered(const PendingPtr& p, bool late) {
  const Gathering::Next next = p->gathering->next(late);
  if (next == Gathering::Next::wait) return;
  if (late && next == Gathering::Next::unavailable && std::chrono::system_clock::now() < p->deadline) return;
  const Gathering gathering = std::move(*p->gathering);
  p->gathering.reset();
  p->alarm->Cancel();
  for (const auto& unary : p->asked) unary->context.TryCancel();
  std::vector<std::string> responses;
  for (const Gathering::Answer* one : gathering.best()) responses.push_back(one->bytes);
  switch (next) {
    case Gathering::Next::send:
      p->unheard = gathering.problem();
      take_endorsed(p, assemble(p->proposal, responses));
      return;
    case Gathering::Next::refused:
      finish(p, Outcome::Kind::refused, gathering.problem());
      return;
    case Gathering::Next::again:
      on_not_endorsed(p, {grpc::StatusCode::UNAVAILABLE, "the peers' answers differ"});
      return;
    default:
      on_not_endorsed(p, {grpc::StatusCode::UNAVAILABLE, "no second organisation endorses: " + gathering.problem()});
  }
}

void Pipeline::endorse(const PendingPtr& p) {
  using Count = EndorsementNeed::Count;
  if (ordering_ && p->need.count == Count::one) {
    const bool own = p->need.organisation.empty();
    const std::string& organisation = own ? connection_->config.identity.name.msp_id : p->need.organisation;
    p->endorser.reset();
    if (organisation == connection_->config.identity.name.msp_id && propose_within(p)) return;
    for (const std::size_t i : endorsers_now()) {
      const bool there = channels_->endorsers[i]->GetState(true) != GRPC_CHANNEL_TRANSIENT_FAILURE &&
                         std::chrono::system_clock::now() >= rest_until_[i];
      if (connection_->config.endorsers[i].msp_id != organisation || (!there && own)) continue;
      p->endorser = i;
      return propose_to(p, *endorsers_[i]);
    }
    if (own) return propose_to(p, *proposals_[connection_->peer()]);
  }
  if (ordering_ && p->need.count != Count::one && gather(p)) return;
  gateway::EndorseRequest request;
  if (p->need.count == Count::one && !p->need.organisation.empty())
    request.add_endorsing_organizations(p->need.organisation);
  request.set_transaction_id(p->proposal.tx_id);
  request.set_channel_id(connection_->config.where.channel);
  request.mutable_proposed_transaction()->ParseFromString(p->proposal.signed_proposal);
  p->endorse = make_unary<gateway::EndorseResponse>(p);
  p->endorse->reader = gateways_[connection_->peer()]->AsyncEndorse(&p->endorse->context, request, &queue_);
  await(p, p->endorse, &Pipeline::on_endorsed);
}

void Pipeline::on_endorsed(const PendingPtr& p) {
  const grpc::Status& status = p->endorse->status;
  if (!status.ok() && p->need.count == EndorsementNeed::Count::two_if_there_are &&
      status.error_code() != grpc::StatusCode::ABORTED && std::chrono::system_clock::now() < p->deadline) {
    p->unheard = describe(status);
    p->need.count = EndorsementNeed::Count::one;
    return propose_to(p, *proposals_[connection_->peer()]);
  }
  if (!status.ok()) return on_not_endorsed(p, status);
  take_endorsed(p, p->endorse->response.prepared_transaction().SerializeAsString());
}

void Pipeline::on_proposed(const PendingPtr& p) {
  if (!p->propose->status.ok()) return on_not_endorsed(p, p->propose->status);
  take_endorsed(p, assemble(p->proposal, {p->propose->response.SerializeAsString()}));
}

void Pipeline::on_not_endorsed(const PendingPtr& p, const grpc::Status& status) {
  const bool silent =
      status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED && std::chrono::system_clock::now() < p->deadline;
  if (const auto endorser = std::exchange(p->endorser, std::nullopt); endorser && (may_pass(status) || silent)) {
    const bool rested = std::chrono::system_clock::now() < rest_until_[*endorser];
    let_rest(*endorser, silent ? silent_rest : rest);
    if (!rested || silent) return endorse(p);  // at once, of another one: at most once while it rests
  }
  if (retry(p, status, &Pipeline::endorse)) return;
  finish(p, not_reached(status) ? Outcome::Kind::unavailable : Outcome::Kind::refused, describe(status));
}

}  // namespace ledgerline::fabric
