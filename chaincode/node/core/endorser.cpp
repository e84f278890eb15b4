#include "chaincode/node/core/endorser.hpp"

#include <map>

#include "common/base/check.hpp"
#include "common/base/text.hpp"
#include "common/msg/contract.hpp"
#include "ledger/rwset/rwset.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::node {
namespace {

std::string refusal(const chaincode::Response& response) {
  return "chaincode response " + std::to_string(response.status) + ", " + response.message;
}

Reply malformed(const std::string& why) {
  return {Code::invalid_argument, "failed to unpack transaction proposal: " + why, {}, {}};
}

protos::Response to_message(const chaincode::Response& response) {
  protos::Response message;
  message.set_status(response.status);
  message.set_message(response.message);
  message.set_payload(response.payload);
  return message;
}

std::string to_payload(const ProposalParts& proposal, const protos::ChaincodeAction& action) {
  protos::ProposalResponsePayload payload;
  payload.set_proposal_hash(
      fabric::proposal_hash(proposal.header.channel_header(), proposal.header.signature_header(), proposal.payload));
  payload.set_extension(action.SerializeAsString());
  return payload.SerializeAsString();
}

/// What a peer signs of an answer of its own contracts: no reads and no writes, and Fabric's name for their version.
std::string system_payload(const ProposalParts& proposal, const chaincode::Response& response) {
  protos::ChaincodeAction action;
  *action.mutable_response() = to_message(response);
  action.mutable_chaincode_id()->set_name(proposal.contract);
  action.mutable_chaincode_id()->set_version("syscc");
  return to_payload(proposal, action);
}

/// That every result of a peer of Fabric has, so that none counts that was made under another definition.
kvrwset::KVRead read_of_sequence(const std::string& contract, const Definition& definition) {
  kvrwset::KVRead read;
  read.set_key("namespaces/fields/" + contract + "/Sequence");
  if (definition.sequence) {
    read.mutable_version()->set_block_num(definition.sequence->block);
    read.mutable_version()->set_tx_num(definition.sequence->tx);
  }
  return read;
}

Result<protos::Endorsement> endorse_by(const crypto::SigningIdentity& peer, const std::string& payload) {
  auto signature = peer.signer->sign(payload + peer.serialized);
  if (!signature) return Error{"signing with the key of " + peer.name.subject + ": " + signature.error().message};
  protos::Endorsement endorsement;
  endorsement.set_endorser(peer.serialized);
  endorsement.set_signature(std::move(*signature));
  return endorsement;
}

}  // namespace

/// A proposal that may be answered, and what the contract said.
struct Endorser::Simulated {
  ProposalParts proposal;
  chaincode::Response response;
  std::string payload;  ///< ProposalResponsePayload; empty: nothing to endorse
};

struct Endorser::Unanswered {
  Kind kind;
  std::string what;
};

Endorser::Endorser(const CoreConfig& config, MemberCheck members, std::vector<crypto::SigningIdentity> peers,
                   const Ledger& ledger)
    : config_(config),
      members_(std::move(members)),
      peers_(std::move(peers)),
      ledger_(ledger),
      history_(ledger, config.contract) {
  LEDGERLINE_CHECK(!peers_.empty(), "somebody endorses", config.channel);
}

std::string Endorser::response_payload(const ProposalParts& proposal, const Simulation& simulation,
                                       const chaincode::Response& response, const Definition& definition) const {
  std::map<std::string, kvrwset::KVRWSet> sets;
  sets[config_.contract] = simulation.read_write_set();
  if (definition_) sets[fabric::lifecycle_name].mutable_reads()->Add(read_of_sequence(config_.contract, definition));
  rwset::TxReadWriteSet results;
  for (const auto& [name, set] : sets) {
    const std::string bytes = set.SerializeAsString();
    if (definition_ && bytes.empty()) continue;
    rwset::NsReadWriteSet& one = *results.add_ns_rwset();
    one.set_namespace_(name);
    one.set_rwset(bytes);
  }
  protos::ChaincodeAction action;
  action.set_results(results.SerializeAsString());
  if (!simulation.event_name().empty()) {
    protos::ChaincodeEvent event;
    event.set_chaincode_id(config_.contract);
    event.set_tx_id(proposal.channel_header.tx_id());
    event.set_event_name(simulation.event_name());
    event.set_payload(simulation.event_payload());
    action.set_events(event.SerializeAsString());
  }
  *action.mutable_response() = to_message(response);
  action.mutable_chaincode_id()->set_name(config_.contract);
  action.mutable_chaincode_id()->set_version(definition.version);
  return to_payload(proposal, action);
}

/// Why the caller's organisation may not write that much more. Commands, and who may do what, are written by anybody.
std::optional<std::string> Endorser::over_share(const Simulation& simulation, const std::string& function,
                                                const std::string& msp_id) const {
  if (contract::is_urgent(function)) return std::nullopt;
  const std::int64_t growth = simulation.growth_bytes();
  const std::size_t stored = ledger_.state().stored_bytes(msp_id);
  if (growth <= 0 || stored + static_cast<std::size_t>(growth) <= config_.max_stored_bytes) return std::nullopt;
  return "the values that " + msp_id + " has written take " + std::to_string(stored) + " bytes, " +
         std::to_string(growth) + " more would be above " + std::to_string(config_.max_stored_bytes) +
         ": delete some of them";
}

std::variant<Endorser::Simulated, Endorser::Unanswered> Endorser::simulate(Result<SignedProposalParts> read, Now now,
                                                                           bool own) {
  if (!read) return Unanswered{Kind::malformed, read.error().message};
  ProposalParts* const proposal = &read->proposal;
  // Of the peer's own contracts some are asked without a channel.
  const bool of_peer = proposal->channel_header.channel_id().empty() && is_system_contract(proposal->contract);
  if (proposal->channel_header.channel_id() != config_.channel && !of_peer) {
    return Unanswered{Kind::unknown_channel,
                      "channel '" + printable(proposal->channel_header.channel_id(), max_name) + "' not found"};
  }
  const std::string& creator = proposal->signature_header.creator();
  auto member =
      own ? members_.check_own(creator, now) : members_.check(creator, read->proposal_bytes, read->signature, now);
  if (!member) return Unanswered{Kind::denied, "error validating proposal: " + member.error().message};
  if (auto answer = query_system_contract(ledger_, config_.channel, *proposal))
    return Simulated{std::move(*proposal), std::move(*answer), {}};
  if (proposal->contract != config_.contract) {
    return Unanswered{Kind::unknown_contract, "no contract named '" + printable(proposal->contract, max_name) +
                                                  "' on channel '" + config_.channel + "'; there is '" +
                                                  config_.contract + "'"};
  }
  const std::string tx_id = proposal->channel_header.tx_id();
  if (ledger_.state().find_tx(tx_id)) {
    return Unanswered{Kind::duplicate, "duplicate transaction found [" + tx_id + "]"};
  }

  std::optional<Definition> definition = Definition{"1", std::nullopt};
  if (definition_ && !(definition = definition_())) {
    return Unanswered{Kind::unknown_contract, "make sure the chaincode " + config_.contract +
                                                  " has been successfully defined on channel " + config_.channel +
                                                  " and try again: chaincode " + config_.contract + " not found"};
  }
  Simulation simulation(ledger_.state(), history_, **member, definition_ ? Ranges::as_fabric : Ranges::as_wanted);
  Simulated result;
  result.response = chaincode::invoke(simulation, proposal->function, proposal->args);
  if (!definition_ && result.response.status < 400) {
    if (auto why = over_share(simulation, proposal->function, (*member)->name.msp_id))
      result.response = chaincode::Response{500, *why, {}};
  }
  if (result.response.status < 400 || definition_)
    result.payload = response_payload(*proposal, simulation, result.response, *definition);
  result.proposal = std::move(*proposal);
  return result;
}

Reply Endorser::endorse(std::string_view signed_proposal, Now now) {
  const auto answer = simulate(read_signed_proposal(signed_proposal), now);
  const std::string failed = "failed to endorse transaction, see attached details for more info";
  if (const auto* none = std::get_if<Unanswered>(&answer)) {
    if (none->kind == Kind::malformed) return malformed(none->what);
    if (none->kind == Kind::denied || none->kind == Kind::duplicate) return {Code::aborted, failed, none->what, {}};
    return {Code::failed_precondition, none->what, none->what, {}};
  }
  const auto& simulated = std::get<Simulated>(answer);
  if (simulated.response.status >= 400) return {Code::aborted, failed, refusal(simulated.response), {}};
  if (simulated.payload.empty()) {
    return {Code::failed_precondition, "'" + simulated.proposal.contract + "' answers questions alone", {}, {}};
  }
  std::vector<protos::Endorsement> endorsements;
  for (const crypto::SigningIdentity& peer : peers_) {
    auto endorsement = endorse_by(peer, simulated.payload);
    if (!endorsement) return {Code::aborted, failed, endorsement.error().message, {}};
    endorsements.push_back(std::move(*endorsement));
  }
  return {Code::ok, {}, {}, make_envelope(simulated.proposal, simulated.payload, endorsements)};
}

Reply Endorser::evaluate(std::string_view signed_proposal, Now now) {
  const auto answer = simulate(read_signed_proposal(signed_proposal), now);
  const std::string failed = "evaluate call to endorser returned error: ";
  if (const auto* none = std::get_if<Unanswered>(&answer)) {
    if (none->kind == Kind::malformed) return malformed(none->what);
    if (none->kind == Kind::unknown_channel) return {Code::unavailable, none->what, none->what, {}};
    return {Code::failed_precondition, failed + none->what, none->what, {}};
  }
  const auto& simulated = std::get<Simulated>(answer);
  if (simulated.response.status >= 400) {
    return {Code::unknown, failed + refusal(simulated.response), refusal(simulated.response), {}};
  }
  return {Code::ok, {}, {}, to_message(simulated.response).SerializeAsString()};
}

Reply Endorser::process_proposal(std::string_view signed_proposal, Now now, std::size_t peer) {
  return reply_of_peer(simulate(read_signed_proposal(signed_proposal), now), peer);
}

Reply Endorser::process_proposal(SignedProposalParts signed_proposal, Now now, std::size_t peer, bool own) {
  return reply_of_peer(simulate(std::move(signed_proposal), now, own), peer);
}

Reply Endorser::reply_of_peer(const std::variant<Simulated, Unanswered>& answer, std::size_t peer) const {
  protos::ProposalResponse response;
  if (const auto* none = std::get_if<Unanswered>(&answer)) {
    if (none->kind != Kind::unknown_channel && none->kind != Kind::unknown_contract)
      return {Code::unknown, none->what, none->what, {}};
    *response.mutable_response() = to_message({500, none->what, {}});
    return {Code::ok, {}, {}, response.SerializeAsString()};
  }
  const auto& simulated = std::get<Simulated>(answer);
  const ProposalParts& proposal = simulated.proposal;
  // A peer of Fabric names no version with a refusal.
  if (!definition_ || simulated.response.status < 400) response.set_version(1);
  *response.mutable_response() = to_message(simulated.response);
  std::string payload = simulated.payload;
  // As Fabric's peers: what they say of a channel they sign, what they are asked without one they do not.
  if (is_system_contract(proposal.contract) && simulated.response.status < 400 &&
      !proposal.channel_header.channel_id().empty())
    payload = system_payload(proposal, simulated.response);
  if (!payload.empty() && simulated.response.status < 400) {
    LEDGERLINE_CHECK(peer < peers_.size(), "each service is one of the peers'", peer, peers_.size());
    auto endorsement = endorse_by(peers_[peer], payload);
    if (!endorsement) return {Code::unknown, endorsement.error().message, {}, {}};
    *response.mutable_endorsement() = std::move(*endorsement);
  }
  response.set_payload(std::move(payload));
  return {Code::ok, {}, {}, response.SerializeAsString()};
}

}  // namespace ledgerline::node
