#include "chaincode/node/core/tx/proposal.hpp"

#include "chaincode/node/core/types.hpp"
#include "common/base/printable.hpp"
#include "common/crypto/crypto.hpp"
#include "common/fabric/tx/envelope.hpp"
#include "ledger/rwset/rwset.pb.h"
#include "peer/chaincode.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::node {
namespace {

bool parse(google::protobuf::MessageLite& message, std::string_view bytes) {
  return message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

}  // namespace

std::string transaction_id(const common::SignatureHeader& header) {
  return crypto::hex(crypto::sha256(header.nonce() + header.creator()));
}

std::string proposal_hash(const common::Header& header, std::string_view payload) {
  std::string bytes = header.channel_header() + header.signature_header();
  bytes.append(payload);
  const crypto::Digest digest = crypto::sha256(bytes);
  return {digest.begin(), digest.end()};
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
  if (parts.signature_header.nonce().empty() || parts.signature_header.creator().empty()) {
    return Error{"the signature header has no nonce or no creator"};
  }
  if (parts.channel_header.tx_id() != transaction_id(parts.signature_header)) {
    return Error{"incorrectly computed txid '" + printable(parts.channel_header.tx_id(), max_name) + "'"};
  }
  protos::ChaincodeProposalPayload payload;
  protos::ChaincodeInvocationSpec spec;
  if (!payload.ParseFromString(proposal.payload()) || !spec.ParseFromString(payload.input())) {
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
  payload.clear_transientmap();
  parts.payload = payload.SerializeAsString();
  return parts;
}

std::string make_envelope(const ProposalParts& proposal, const std::string& response_payload,
                          const std::vector<protos::Endorsement>& endorsements) {
  return fabric::unsigned_envelope(proposal.header, proposal.payload, response_payload, endorsements);
}

TransactionParts read_transaction(std::string_view bytes) {
  TransactionParts parts;
  const auto wrong = [&](int code) {
    parts.code = code;
    return parts;
  };
  common::Envelope envelope;
  common::Payload payload;
  if (!parse(envelope, bytes) || !payload.ParseFromString(envelope.payload())) return wrong(protos::BAD_PAYLOAD);
  if (!parts.channel_header.ParseFromString(payload.header().channel_header()))
    return wrong(protos::BAD_CHANNEL_HEADER);
  if (!parts.signature_header.ParseFromString(payload.header().signature_header())) {
    return wrong(protos::BAD_COMMON_HEADER);
  }
  if (parts.channel_header.tx_id() != transaction_id(parts.signature_header)) return wrong(protos::BAD_PROPOSAL_TXID);

  protos::Transaction transaction;
  protos::ChaincodeActionPayload action;
  if (!transaction.ParseFromString(payload.data())) return wrong(protos::BAD_PAYLOAD);
  if (transaction.actions_size() != 1) return wrong(protos::INVALID_ENDORSER_TRANSACTION);
  if (transaction.actions(0).header() != payload.header().signature_header() ||
      !action.ParseFromString(transaction.actions(0).payload())) {
    return wrong(protos::INVALID_ENDORSER_TRANSACTION);
  }
  parts.response_payload = action.action().proposal_response_payload();
  parts.endorsements.assign(action.action().endorsements().begin(), action.action().endorsements().end());
  protos::ProposalResponsePayload response;
  if (!response.ParseFromString(parts.response_payload) || !parts.action.ParseFromString(response.extension())) {
    return wrong(protos::BAD_RESPONSE_PAYLOAD);
  }
  if (response.proposal_hash() != proposal_hash(payload.header(), action.chaincode_proposal_payload())) {
    return wrong(protos::INVALID_ENDORSER_TRANSACTION);
  }
  return parts;
}

ContractSet read_contract_set(const protos::ChaincodeAction& action, const std::string& contract) {
  ContractSet result;
  rwset::TxReadWriteSet all;
  if (!all.ParseFromString(action.results())) return {protos::BAD_RWSET, {}};
  for (const rwset::NsReadWriteSet& part : all.ns_rwset()) {
    if (part.namespace_() != contract || !part.collection_hashed_rwset().empty()) return {protos::ILLEGAL_WRITESET, {}};
    if (!result.set.MergeFromString(part.rwset())) return {protos::BAD_RWSET, {}};
  }
  return result;
}

}  // namespace ledgerline::node
