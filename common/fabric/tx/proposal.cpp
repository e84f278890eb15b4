#include "common/base/text.hpp"
#include "common/common.pb.h"
#include "common/fabric/tx/envelope.hpp"
#include "common/fabric/tx/form.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "orderer/ab.pb.h"
#include "peer/chaincode.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {
namespace {

google::protobuf::Timestamp timestamp_of(TimeNs real_ns) {
  google::protobuf::Timestamp time;
  time.set_seconds(real_ns / ns_per_s);
  time.set_nanos(static_cast<std::int32_t>(real_ns % ns_per_s));
  return time;
}

common::SignatureHeader signer_of(const crypto::SigningIdentity& who, std::string nonce) {
  common::SignatureHeader signer;
  signer.set_creator(who.serialized);
  signer.set_nonce(std::move(nonce));
  return signer;
}

common::ChannelHeader channel_header(common::HeaderType type, const std::string& channel,
                                     const google::protobuf::Timestamp& time) {
  common::ChannelHeader header;
  header.set_type(type);
  header.set_channel_id(channel);
  header.mutable_timestamp()->set_seconds(time.seconds());
  header.mutable_timestamp()->set_nanos(time.nanos());
  return header;
}

common::Header whole_header(const common::ChannelHeader& channel, const common::SignatureHeader& who) {
  common::SignatureHeader signature;
  signature.set_creator(who.creator());
  signature.set_nonce(who.nonce());
  common::Header header;
  header.set_channel_header(channel.SerializeAsString());
  header.set_signature_header(signature.SerializeAsString());
  return header;
}

Result<std::string> signed_envelope(const crypto::SigningIdentity& who, std::string payload) {
  auto signature = who.signer->sign(payload);
  if (!signature) return signature.error();
  common::Envelope envelope;
  envelope.set_payload(std::move(payload));
  envelope.set_signature(std::move(*signature));
  return envelope.SerializeAsString();
}

/// The call in a ChaincodeProposalPayload; what else is in it (the transient map) does not travel with the transaction.
std::string input_of(const std::string& proposal_payload) {
  protos::ChaincodeProposalPayload payload;
  return parse(payload, proposal_payload) ? payload.input() : std::string();
}

Status check_event(const Proposal& proposal, const std::string& asked_channel_header, const std::string& events,
                   const EventCheck& event_check) {
  protos::ChaincodeEvent event;
  if (!events.empty()) {
    common::ChannelHeader channel;
    protos::ChaincodeHeaderExtension extension;
    if (!parse(event, events) || !parse(channel, asked_channel_header) || !parse(extension, channel.extension()))
      return Error{"the event of the endorsed transaction is malformed; it was not signed"};
    if (event.tx_id() != proposal.tx_id || event.chaincode_id() != extension.chaincode_id().name())
      return Error{"the event of the endorsed transaction names another transaction or contract; it was not signed"};
  }
  if (!event_check) return done;
  if (const Status checked = event_check(event.event_name(), event.payload()); !checked)
    return Error{"the peer's result is not what was asked for: " + checked.error().message + "; it was not signed"};
  return done;
}

}  // namespace

std::string words_of_peer(std::string_view text) {
  constexpr std::size_t max_words = 8'000;
  return printable(text, max_words);
}

std::string proposal_bytes(const common::SignatureHeader& who, const ChannelAndContract& where, const Call& call,
                           const google::protobuf::Timestamp& time) {
  protos::ChaincodeHeaderExtension extension;
  extension.mutable_chaincode_id()->set_name(where.contract);
  common::ChannelHeader channel = channel_header(common::ENDORSER_TRANSACTION, where.channel, time);
  channel.set_tx_id(transaction_id(who));
  channel.set_extension(extension.SerializeAsString());

  protos::ChaincodeInvocationSpec invocation;
  protos::ChaincodeSpec& spec = *invocation.mutable_chaincode_spec();
  spec.set_type(protos::ChaincodeSpec::NODE);  // peers ignore it; Fabric's own gateway clients send this value
  spec.mutable_chaincode_id()->set_name(where.contract);
  spec.mutable_input()->add_args(call.function);
  for (const std::string& arg : call.args) spec.mutable_input()->add_args(arg);
  protos::ChaincodeProposalPayload payload;
  payload.set_input(invocation.SerializeAsString());

  protos::Proposal proposal;
  proposal.set_header(whole_header(channel, who).SerializeAsString());
  proposal.set_payload(payload.SerializeAsString());
  return proposal.SerializeAsString();
}

Result<Proposal> make_proposal(const crypto::SigningIdentity& who, const ChannelAndContract& where, const Call& call,
                               TimeNs timestamp_ns, std::string nonce) {
  const common::SignatureHeader signer = signer_of(who, std::move(nonce));
  protos::SignedProposal signed_proposal;
  signed_proposal.set_proposal_bytes(proposal_bytes(signer, where, call, timestamp_of(timestamp_ns)));
  auto signature = who.signer->sign(signed_proposal.proposal_bytes());
  if (!signature) return signature.error();
  signed_proposal.set_signature(std::move(*signature));
  return Proposal{transaction_id(signer), signed_proposal.SerializeAsString()};
}

Result<std::string> assemble(const Proposal& proposal, const std::vector<std::string>& responses) {
  protos::SignedProposal signed_proposal;
  protos::Proposal asked;
  common::Header header;
  protos::ChaincodeProposalPayload input;
  if (!parse(signed_proposal, proposal.signed_proposal) || !parse(asked, signed_proposal.proposal_bytes()) ||
      !parse(header, asked.header()) || !parse(input, asked.payload())) {
    return Error{"the proposal is malformed"};
  }
  input.clear_transientmap();
  std::string result;
  std::vector<protos::Endorsement> endorsements;
  for (const std::string& bytes : responses) {
    protos::ProposalResponse response;
    if (!parse(response, bytes)) return Error{"a peer's answer is malformed"};
    if (response.response().status() >= 400) {
      return Error{"chaincode response " + std::to_string(response.response().status()) + ", " +
                   words_of_peer(response.response().message())};
    }
    if (!response.has_endorsement()) return Error{"a peer's answer has no endorsement"};
    if (result.empty()) result = response.payload();
    if (result != response.payload()) return Error{"the peers' answers differ"};
    endorsements.push_back(response.endorsement());
  }
  return unsigned_envelope(header, input.SerializeAsString(), result, endorsements);
}

std::string unsigned_envelope(const common::Header& header, const std::string& payload,
                              const std::string& response_payload,
                              const std::vector<protos::Endorsement>& endorsements) {
  protos::ChaincodeActionPayload action;
  action.set_chaincode_proposal_payload(payload);
  action.mutable_action()->set_proposal_response_payload(response_payload);
  for (const protos::Endorsement& one : endorsements) *action.mutable_action()->add_endorsements() = one;
  protos::Transaction transaction;
  transaction.add_actions()->set_header(header.signature_header());
  transaction.mutable_actions(0)->set_payload(action.SerializeAsString());
  common::Payload whole;
  *whole.mutable_header() = header;
  whole.set_data(transaction.SerializeAsString());
  common::Envelope envelope;
  envelope.set_payload(whole.SerializeAsString());
  return envelope.SerializeAsString();
}

Result<std::string> check_prepared(const Proposal& proposal, std::string_view unsigned_envelope,
                                   const EventCheck& event_check) {
  protos::SignedProposal signed_proposal;
  protos::Proposal asked;
  common::Header asked_header;
  if (!parse(signed_proposal, proposal.signed_proposal) || !parse(asked, signed_proposal.proposal_bytes()) ||
      !parse(asked_header, asked.header())) {
    return Error{"the proposal is malformed"};
  }
  auto opened = open_transaction(unsigned_envelope);
  if (!opened) return Error{"the endorsed transaction that came back is malformed: " + opened.error().message};
  const common::Header& header = opened->payload.header();
  if (header.channel_header() != asked_header.channel_header() ||
      header.signature_header() != asked_header.signature_header() ||
      opened->transaction.actions(0).header() != asked_header.signature_header() ||
      input_of(opened->action.chaincode_proposal_payload()) != input_of(asked.payload())) {
    return Error{"the endorsed transaction that came back is not the one that was asked for; it was not signed"};
  }
  const Status checked = check_event(proposal, asked_header.channel_header(), opened->result.events(), event_check);
  if (!checked) return checked.error();
  return std::move(*opened->result.mutable_response()->mutable_payload());
}

Result<std::string> sign_envelope(const crypto::SigningIdentity& who, std::string_view unsigned_envelope) {
  common::Envelope envelope;
  if (!parse(envelope, unsigned_envelope)) return Error{"the endorsed transaction that came back is malformed"};
  return signed_envelope(who, std::move(*envelope.mutable_payload()));
}

Result<std::string> make_seek(const crypto::SigningIdentity& who, const std::string& channel,
                              std::optional<std::uint64_t> start, TimeNs timestamp_ns, std::string nonce, SeekStop stop,
                              const std::string& tls_hash) {
  orderer::SeekInfo seek;
  if (start) {
    seek.mutable_start()->mutable_specified()->set_number(*start);
  } else {
    seek.mutable_start()->mutable_newest();
  }
  if (stop == SeekStop::at_start) {
    *seek.mutable_stop() = seek.start();
    seek.set_behavior(orderer::SeekInfo::FAIL_IF_NOT_READY);
  } else {
    seek.mutable_stop()->mutable_specified()->set_number(UINT64_MAX);
    seek.set_behavior(orderer::SeekInfo::BLOCK_UNTIL_READY);
  }
  common::Payload payload;
  common::ChannelHeader header = channel_header(common::DELIVER_SEEK_INFO, channel, timestamp_of(timestamp_ns));
  header.set_tls_cert_hash(tls_hash);
  *payload.mutable_header() = whole_header(header, signer_of(who, std::move(nonce)));
  payload.set_data(seek.SerializeAsString());
  return signed_envelope(who, payload.SerializeAsString());
}

}  // namespace ledgerline::fabric
