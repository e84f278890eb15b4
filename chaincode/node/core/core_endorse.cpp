#include "chaincode/node/core/core_parts.hpp"
#include "ledger/rwset/rwset.pb.h"
#include "msp/identities.pb.h"
#include "peer/transaction.pb.h"

/// The endorsing half of the core: proposals are checked, run and signed.
namespace ledgerline::node {
namespace {

using Kind = Unanswered::Kind;

std::string refusal(const chaincode::Response& response) {
  return "chaincode response " + std::to_string(response.status) + ", " + response.message;
}

protos::Response to_message(const chaincode::Response& response) {
  protos::Response message;
  message.set_status(response.status);
  message.set_message(response.message);
  message.set_payload(response.payload);
  return message;
}

}  // namespace

Result<std::shared_ptr<const crypto::MspRegistry::Member>> NodeCore::Parts::check(std::string_view serialized,
                                                                                  std::string_view message,
                                                                                  std::string_view signature, Now now) {
  auto member = registry->member(serialized, now.real_ns / ns_per_s);
  if (!member) {
    return Error{"access denied: channel [" + config.channel + "] creator org unknown: " + member.error().what};
  }
  if (!(*member)->verifier->verify(message, signature)) {
    return Error{"access denied: channel [" + config.channel + "] creator org [" + (*member)->name.msp_id +
                 "]: the signature is invalid"};
  }
  return member;
}

bool NodeCore::Parts::has_expired(const std::string& serialized, Now now) {
  msp::SerializedIdentity identity;
  if (!identity.ParseFromString(serialized)) return false;
  const auto certificate = crypto::parse_certificate(identity.id_bytes());
  return certificate && certificate->not_after_s < now.real_ns / ns_per_s;
}

std::variant<Simulated, Unanswered> NodeCore::Parts::simulate(std::string_view signed_proposal, Now now) {
  protos::SignedProposal outer;
  if (!outer.ParseFromArray(signed_proposal.data(), static_cast<int>(signed_proposal.size()))) {
    return Unanswered{Kind::malformed, "error unmarshaling the signed proposal"};
  }
  auto proposal = read_proposal(outer.proposal_bytes());
  if (!proposal) return Unanswered{Kind::malformed, proposal.error().what};
  // Of the peer's own contracts some are asked without a channel.
  const bool of_peer = proposal->channel_header.channel_id().empty() && is_system(proposal->contract);
  if (proposal->channel_header.channel_id() != config.channel && !of_peer) {
    return Unanswered{Kind::unknown_channel,
                      "channel '" + printable(proposal->channel_header.channel_id(), max_name) + "' not found"};
  }
  auto member = check(proposal->signature_header.creator(), outer.proposal_bytes(), outer.signature(), now);
  if (!member) return Unanswered{Kind::denied, "error validating proposal: " + member.error().what};
  if (auto answer = ask_system(*proposal)) return Simulated{std::move(*proposal), std::move(*answer), {}};
  if (proposal->contract != config.contract) {
    return Unanswered{Kind::unknown_contract, "no contract named '" + printable(proposal->contract, max_name) +
                                                  "' on channel '" + config.channel + "'; there is '" +
                                                  config.contract + "'"};
  }
  const std::string tx_id = proposal->channel_header.tx_id();
  if (state.find_tx(tx_id)) {
    return Unanswered{Kind::duplicate, "duplicate transaction found [" + tx_id + "]"};
  }

  Simulation simulation(state, read_version, **member);
  Simulated result;
  result.response = chaincode::invoke(simulation, proposal->function, proposal->args);
  if (result.response.status < 400) {
    rwset::TxReadWriteSet results;
    rwset::NsReadWriteSet& contract_set = *results.add_ns_rwset();
    contract_set.set_namespace_(config.contract);
    contract_set.set_rwset(simulation.read_write_set().SerializeAsString());
    protos::ChaincodeAction action;
    action.set_results(results.SerializeAsString());
    if (simulation.has_event()) {
      protos::ChaincodeEvent event;
      event.set_chaincode_id(config.contract);
      event.set_tx_id(tx_id);
      event.set_event_name(simulation.event_name());
      event.set_payload(simulation.event_payload());
      action.set_events(event.SerializeAsString());
    }
    *action.mutable_response() = to_message(result.response);
    action.mutable_chaincode_id()->set_name(config.contract);
    action.mutable_chaincode_id()->set_version("1");
    protos::ProposalResponsePayload payload;
    payload.set_proposal_hash(proposal_hash(proposal->header, proposal->payload));
    payload.set_extension(action.SerializeAsString());
    result.payload = payload.SerializeAsString();
  }
  result.proposal = std::move(*proposal);
  return result;
}

Result<protos::Endorsement> NodeCore::Parts::endorse_by(const crypto::SigningIdentity& peer,
                                                        const std::string& payload) const {
  auto signature = peer.signer->sign(payload + peer.serialized);
  if (!signature) return Error{"signing with the key of " + peer.name.subject + ": " + signature.error().what};
  protos::Endorsement endorsement;
  endorsement.set_endorser(peer.serialized);
  endorsement.set_signature(std::move(*signature));
  return endorsement;
}

Reply NodeCore::endorse(std::string_view signed_proposal, Now now) {
  const auto answer = parts_->simulate(signed_proposal, now);
  const std::string failed = "failed to endorse transaction, see attached details for more info";
  if (const auto* none = std::get_if<Unanswered>(&answer)) {
    switch (none->kind) {
      case Kind::malformed:
        return {Code::invalid_argument, "failed to unpack transaction proposal: " + none->what, {}, {}};
      case Kind::unknown_channel:
      case Kind::unknown_contract:
        return {Code::failed_precondition, none->what, none->what, {}};
      case Kind::denied:
      case Kind::duplicate:
        return {Code::aborted, failed, none->what, {}};
    }
  }
  const auto& simulated = std::get<Simulated>(answer);
  if (simulated.response.status >= 400) return {Code::aborted, failed, refusal(simulated.response), {}};
  if (simulated.payload.empty()) {
    return {Code::failed_precondition, "'" + simulated.proposal.contract + "' answers questions alone", {}, {}};
  }
  std::vector<protos::Endorsement> endorsements;
  for (const crypto::SigningIdentity& peer : parts_->peers) {
    auto endorsement = parts_->endorse_by(peer, simulated.payload);
    if (!endorsement) return {Code::aborted, failed, endorsement.error().what, {}};
    endorsements.push_back(std::move(*endorsement));
  }
  return {Code::ok, {}, {}, make_envelope(simulated.proposal, simulated.payload, endorsements)};
}

Reply NodeCore::evaluate(std::string_view signed_proposal, Now now) {
  const auto answer = parts_->simulate(signed_proposal, now);
  const std::string failed = "evaluate call to endorser returned error: ";
  if (const auto* none = std::get_if<Unanswered>(&answer)) {
    switch (none->kind) {
      case Kind::malformed:
        return {Code::invalid_argument, "failed to unpack transaction proposal: " + none->what, {}, {}};
      case Kind::unknown_channel:
        return {Code::unavailable, none->what, none->what, {}};
      case Kind::unknown_contract:
      case Kind::denied:
      case Kind::duplicate:
        return {Code::failed_precondition, failed + none->what, none->what, {}};
    }
  }
  const auto& simulated = std::get<Simulated>(answer);
  if (simulated.response.status >= 400) {
    return {Code::unknown, failed + refusal(simulated.response), refusal(simulated.response), {}};
  }
  return {Code::ok, {}, {}, to_message(simulated.response).SerializeAsString()};
}

Reply NodeCore::process_proposal(std::string_view signed_proposal, Now now) {
  const auto answer = parts_->simulate(signed_proposal, now);
  protos::ProposalResponse response;
  if (const auto* none = std::get_if<Unanswered>(&answer)) {
    switch (none->kind) {
      case Kind::unknown_channel:
      case Kind::unknown_contract:
        *response.mutable_response() = to_message({500, none->what, {}});
        return {Code::ok, {}, {}, response.SerializeAsString()};
      default:
        return {Code::unknown, none->what, none->what, {}};
    }
  }
  const auto& simulated = std::get<Simulated>(answer);
  response.set_version(1);
  *response.mutable_response() = to_message(simulated.response);
  if (!simulated.payload.empty()) {
    auto endorsement = parts_->endorse_by(parts_->peers.front(), simulated.payload);
    if (!endorsement) return {Code::unknown, endorsement.error().what, {}, {}};
    *response.mutable_endorsement() = std::move(*endorsement);
    response.set_payload(simulated.payload);
  }
  return {Code::ok, {}, {}, response.SerializeAsString()};
}

}  // namespace ledgerline::node
