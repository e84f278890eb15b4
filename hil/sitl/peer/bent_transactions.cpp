#include "hil/sitl/peer/bent_transactions.hpp"

#include "chaincode/node/core/tx/block.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/contract.hpp"
#include "ledgerline.pb.h"
#include "peer/chaincode_event.pb.h"

namespace ledgerline::hil {
namespace {

constexpr TimeNs some_time_ns = 1'767'225'600 * ns_per_s;

protos::ChaincodeInvocationSpec call_of(const fabric::OpenedTransaction& opened) {
  const auto proposal = parsed<protos::ChaincodeProposalPayload>(opened.action.chaincode_proposal_payload());
  return parsed<protos::ChaincodeInvocationSpec>(proposal.input());
}

std::string faster(const std::string& command) {
  auto plans = parsed<CommandCall>(command);
  for (DronePlan& plan : *plans.mutable_plans()) {
    for (PlannedSetpoint& setpoint : *plan.mutable_setpoints()) setpoint.set_vx(2);
    plan.set_sequence(plan.sequence() + 1000);
  }
  return plans.SerializeAsString();
}

/// As a peer's contract would answer, with that event.
std::string own_transaction(const crypto::SigningIdentity& peer, const fabric::Call& call, const std::string& event,
                            std::uint64_t number) {
  std::string nonce = std::to_string(number);
  nonce.resize(24, '.');
  const auto proposal = fabric::make_proposal(peer, {}, call, some_time_ns, nonce);
  if (!proposal) return {};
  const auto signed_proposal = parsed<protos::SignedProposal>(proposal->signed_proposal);
  const auto whole = parsed<protos::Proposal>(signed_proposal.proposal_bytes());
  const auto header = parsed<common::Header>(whole.header());
  protos::ChaincodeEvent sent;
  sent.set_chaincode_id("ledgerline");
  sent.set_tx_id(proposal->tx_id);
  sent.set_event_name(call.function);
  sent.set_payload(event);
  protos::ChaincodeAction action;
  action.mutable_chaincode_id()->set_name("ledgerline");
  action.mutable_chaincode_id()->set_version("1");
  action.mutable_response()->set_status(200);
  action.set_events(sent.SerializeAsString());
  protos::ProposalResponsePayload payload;
  payload.set_proposal_hash(fabric::proposal_hash(header.channel_header(), header.signature_header(), whole.payload()));
  payload.set_extension(action.SerializeAsString());
  protos::ProposalResponse response;
  response.mutable_response()->set_status(200);
  response.set_payload(payload.SerializeAsString());
  response.mutable_endorsement()->set_endorser(peer.serialized);
  const auto signature = peer.signer->sign(response.payload() + peer.serialized);
  if (signature) response.mutable_endorsement()->set_signature(*signature);
  const auto envelope = fabric::assemble(*proposal, {response.SerializeAsString()});
  const auto sealed = envelope ? fabric::sign_envelope(peer, *envelope) : envelope;
  return sealed ? *sealed : std::string();
}

}  // namespace

std::string called_function(const std::string& envelope) {
  const auto opened = fabric::open_transaction(envelope);
  if (!opened) return {};
  const auto call = call_of(*opened);
  const auto& args = call.chaincode_spec().input().args();
  return args.empty() ? std::string() : args[0];
}

void bend_plan(std::string& envelope) {
  auto opened = fabric::open_transaction(envelope);
  if (!opened) return;
  auto event = parsed<protos::ChaincodeEvent>(opened->result.events());
  event.set_payload(faster(event.payload()));
  opened->result.set_events(event.SerializeAsString());
  opened->seal_result();
  envelope = opened->bytes();
}

void break_creator(std::string& envelope) {
  auto whole = parsed<common::Envelope>(envelope);
  if (!whole.signature().empty()) (*whole.mutable_signature())[0] ^= 1;
  envelope = whole.SerializeAsString();
}

void endorse_by(std::string& envelope, const crypto::SigningIdentity* peer) {
  auto opened = fabric::open_transaction(envelope);
  if (!opened) return;
  auto& action = *opened->action.mutable_action();
  action.clear_endorsements();
  if (peer != nullptr) {
    protos::Endorsement& one = *action.add_endorsements();
    one.set_endorser(peer->serialized);
    const auto signature = peer->signer->sign(action.proposal_response_payload() + peer->serialized);
    if (signature) one.set_signature(*signature);
  }
  envelope = opened->bytes();
}

void name_channel(std::string& envelope, const std::string& channel) {
  auto opened = fabric::open_transaction(envelope);
  if (!opened) return;
  auto header = parsed<common::ChannelHeader>(opened->payload.header().channel_header());
  header.set_channel_id(channel);
  opened->payload.mutable_header()->set_channel_header(header.SerializeAsString());
  envelope = opened->bytes();
}

std::string own_stop(const crypto::SigningIdentity& peer, std::uint64_t number) {
  DronesCall drones;
  drones.add_drones("tello1");
  Stops stops;
  stops.add_stops()->set_drone("tello1");
  return own_transaction(peer, {contract::stop, {drones.SerializeAsString()}}, stops.SerializeAsString(), number);
}

std::string own_command(const crypto::SigningIdentity& peer, const std::string& envelope, std::uint64_t number) {
  const auto opened = fabric::open_transaction(envelope);
  if (!opened) return {};
  const auto call = call_of(*opened);
  const auto& args = call.chaincode_spec().input().args();
  if (args.size() < 2) return {};
  const std::string plans = faster(args[1]);
  return own_transaction(peer, {contract::command, {plans}}, plans, number);
}

std::string own_config(const crypto::SigningIdentity& peer, const std::string& authority) {
  node::CoreConfig config;
  config.organisations = {{peer.name.msp_id, authority}};
  config.orderers = {peer.name.msp_id, authority};
  return node::make_config_envelope(config, peer);
}

void name_config(std::string& signatures, std::uint64_t number) {
  auto metadata = parsed<common::Metadata>(signatures);
  auto value = parsed<common::OrdererBlockMetadata>(metadata.value());
  value.mutable_last_config()->set_index(number);
  metadata.set_value(value.SerializeAsString());
  signatures = metadata.SerializeAsString();
}

}  // namespace ledgerline::hil
