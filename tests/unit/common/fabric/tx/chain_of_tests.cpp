#include "tests/unit/common/fabric/tx/chain_of_tests.hpp"

#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "peer/chaincode_event.pb.h"

namespace ledgerline::fabric {
namespace {

template <typename Message>
Message parsed(const std::string& bytes) {
  Message message;
  message.ParseFromString(bytes);
  return message;
}

protos::Proposal proposal_of(const std::string& signed_proposal) {
  return parsed<protos::Proposal>(parsed<protos::SignedProposal>(signed_proposal).proposal_bytes());
}

std::string digest(const std::string& bytes) {
  const crypto::Digest d = crypto::sha256(bytes);
  return {d.begin(), d.end()};
}

}  // namespace

Call call_of(const std::string& signed_proposal) {
  const auto payload = parsed<protos::ChaincodeProposalPayload>(proposal_of(signed_proposal).payload());
  const auto input = parsed<protos::ChaincodeInvocationSpec>(payload.input()).chaincode_spec().input();
  Call call;
  if (input.args_size() > 0) call.function = input.args(0);
  for (int i = 1; i < input.args_size(); ++i) call.args.push_back(input.args(i));
  return call;
}

common::Envelope endorse(const std::string& signed_proposal, const std::vector<crypto::SigningIdentity>& peers,
                         const std::string& answer, const std::string& event_name, const std::string& event_payload) {
  const protos::Proposal proposal = proposal_of(signed_proposal);
  const auto header = parsed<common::Header>(proposal.header());
  const auto channel = parsed<common::ChannelHeader>(header.channel_header());
  const auto extension = parsed<protos::ChaincodeHeaderExtension>(channel.extension());

  protos::ChaincodeEvent event;
  event.set_chaincode_id(extension.chaincode_id().name());
  event.set_tx_id(channel.tx_id());
  event.set_event_name(event_name);
  event.set_payload(event_payload);
  protos::ChaincodeAction result;
  result.mutable_response()->set_status(200);
  result.mutable_response()->set_payload(answer);
  *result.mutable_chaincode_id() = extension.chaincode_id();
  if (!event_name.empty()) result.set_events(event.SerializeAsString());
  protos::ProposalResponsePayload response;
  response.set_proposal_hash(proposal_hash(header.channel_header(), header.signature_header(), proposal.payload()));
  response.set_extension(result.SerializeAsString());
  const std::string response_payload = response.SerializeAsString();

  std::vector<protos::Endorsement> endorsements;
  for (const crypto::SigningIdentity& peer : peers) {
    protos::Endorsement& endorsement = endorsements.emplace_back();
    endorsement.set_endorser(peer.serialized);
    endorsement.set_signature(peer.signer->sign(response_payload + peer.serialized).value());
  }
  return parsed<common::Envelope>(unsigned_envelope(header, proposal.payload(), response_payload, endorsements));
}

std::string tx_id_of(const common::Envelope& envelope) {
  const auto payload = parsed<common::Payload>(envelope.payload());
  return parsed<common::ChannelHeader>(payload.header().channel_header()).tx_id();
}

std::string make_transaction(const crypto::SigningIdentity& client, const crypto::SigningIdentity& peer,
                             const Call& call, const std::string& nonce) {
  const Proposal proposal = make_proposal(client, {}, call, 1'700'000'000 * ns_per_s, nonce).value();
  const auto envelope = endorse(proposal.signed_proposal, {peer}, "answer to " + call.function, call.function,
                                call.args.empty() ? "" : call.args[0]);
  return sign_envelope(client, envelope.SerializeAsString()).value();
}

std::string with_foreign_event(const std::string& bytes) {
  OpenedTransaction opened = open_transaction(bytes).value();
  auto event = parsed<protos::ChaincodeEvent>(opened.result.events());
  event.set_tx_id("another");
  opened.result.set_events(event.SerializeAsString());
  return opened.bytes();
}

void seal(common::Block& block, const common::Block* previous) {
  std::string entries;
  for (const std::string& entry : block.data().data()) entries += entry;
  block.mutable_header()->set_data_hash(digest(entries));
  if (previous == nullptr) return;
  const common::BlockHeader& before = previous->header();
  block.mutable_header()->set_previous_hash(
      block_header_hash(before.number(), before.previous_hash(), before.data_hash()));
}

common::Block make_block(const common::Block* previous, const std::vector<std::string>& envelopes,
                         const std::string& flags) {
  common::Block block;
  block.mutable_header()->set_number(previous == nullptr ? 0 : previous->header().number() + 1);
  for (const std::string& envelope : envelopes) block.mutable_data()->add_data(envelope);
  for (int i = 0; i < 5; ++i) block.mutable_metadata()->add_metadata("");
  block.mutable_metadata()->set_metadata(2, flags);
  seal(block, previous);
  return block;
}

common::Block make_config_block(const std::string& channel) {
  common::ChannelHeader header;
  header.set_type(common::CONFIG);
  header.set_channel_id(channel);
  common::Payload payload;
  payload.mutable_header()->set_channel_header(header.SerializeAsString());
  common::Envelope envelope;
  envelope.set_payload(payload.SerializeAsString());
  return make_block(nullptr, {envelope.SerializeAsString()}, std::string(1, '\0'));
}

}  // namespace ledgerline::fabric
