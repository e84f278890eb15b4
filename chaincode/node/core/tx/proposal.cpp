#include "chaincode/node/core/tx/messages.hpp"

#include "chaincode/node/core/types.hpp"
#include "common/base/text.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "peer/chaincode.pb.h"

namespace ledgerline::node {
namespace {

bool parse(google::protobuf::MessageLite& message, std::string_view bytes) {
  return message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

/// Both layers of a ChaincodeProposalPayload. False: one does not parse.
bool parse_call(const std::string& bytes, protos::ChaincodeProposalPayload& payload,
                protos::ChaincodeInvocationSpec& spec) {
  return payload.ParseFromString(bytes) && spec.ParseFromString(payload.input());
}

}  // namespace

std::optional<CalledFunction> read_called(const std::string& proposal_payload) {
  protos::ChaincodeProposalPayload payload;
  protos::ChaincodeInvocationSpec spec;
  if (!parse_call(proposal_payload, payload, spec)) return std::nullopt;
  const auto& args = spec.chaincode_spec().input().args();
  return CalledFunction{spec.chaincode_spec().chaincode_id().name(), args.empty() ? "" : args[0]};
}

Result<ProposalParts> read_proposal(std::string_view proposal_bytes) {
  ProposalParts parts;
  protos::Proposal proposal;
  protos::ChaincodeHeaderExtension extension;
  if (!parse(proposal, proposal_bytes) || !parts.header.ParseFromString(proposal.header()) ||
      !parts.channel_header.ParseFromString(parts.header.channel_header()) ||
      !parts.signature_header.ParseFromString(parts.header.signature_header()) ||
      !extension.ParseFromString(parts.channel_header.extension())) {
    return Error{"error unmarshaling the proposal"};
  }
  if (parts.channel_header.type() != common::ENDORSER_TRANSACTION) {
    return Error{"invalid header type " + std::to_string(parts.channel_header.type())};
  }
  if (parts.channel_header.epoch() != 0) return Error{"epoch is non-zero"};
  if (parts.signature_header.nonce().empty() || parts.signature_header.creator().empty()) {
    return Error{"the signature header has no nonce or no creator"};
  }
  if (parts.channel_header.tx_id() != fabric::transaction_id(parts.signature_header)) {
    return Error{"incorrectly computed txid '" + printable(parts.channel_header.tx_id(), max_name) + "'"};
  }
  protos::ChaincodeProposalPayload payload;
  protos::ChaincodeInvocationSpec spec;
  if (!parse_call(proposal.payload(), payload, spec)) {
    return Error{"error unmarshaling the proposal's payload"};
  }
  parts.contract = extension.chaincode_id().name();
  if (spec.chaincode_spec().chaincode_id().name() != parts.contract) {
    return Error{"the header names contract " + printable(parts.contract, max_name) + ", the payload " +
                 printable(spec.chaincode_spec().chaincode_id().name(), max_name)};
  }
  const auto& args = spec.chaincode_spec().input().args();
  if (!args.empty()) parts.function = args[0];
  for (int i = 1; i < args.size(); ++i) parts.args.push_back(args[i]);
  protos::ChaincodeProposalPayload for_transaction;  // and of it no field that nobody knows, as a peer makes it
  for_transaction.set_input(payload.input());
  parts.payload = for_transaction.SerializeAsString();
  return parts;
}

Result<SignedProposalParts> read_signed_proposal(std::string_view signed_proposal) {
  protos::SignedProposal outer;
  if (!parse(outer, signed_proposal)) return Error{"error unmarshaling the signed proposal"};
  auto proposal = read_proposal(outer.proposal_bytes());
  if (!proposal) return proposal.error();
  return SignedProposalParts{std::move(*proposal), std::move(*outer.mutable_proposal_bytes()),
                             std::move(*outer.mutable_signature())};
}

std::string make_envelope(const ProposalParts& proposal, const std::string& response_payload,
                          const std::vector<protos::Endorsement>& endorsements) {
  return fabric::unsigned_envelope(proposal.header, proposal.payload, response_payload, endorsements);
}

kvrwset::KVRWSet set_of(const fabric::ReadWriteSet& sets, const std::string& contract) {
  kvrwset::KVRWSet own;
  for (const fabric::NamespaceSet& part : sets.parts) {
    if (part.name == contract && part.collection.empty()) own.MergeFrom(part.set);
  }
  return own;
}

}  // namespace ledgerline::node
