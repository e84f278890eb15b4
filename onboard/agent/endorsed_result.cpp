#include "onboard/agent/endorsed_result.hpp"

#include "common/common.pb.h"
#include "common/crypto/crypto.hpp"
#include "peer/chaincode_event.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::agent {

std::optional<EndorsedResult> endorsed_result(const fabric::Transaction& tx) {
  protos::ProposalResponsePayload response;
  protos::ChaincodeAction action;
  protos::ChaincodeEvent event;
  if (!response.ParseFromString(tx.response_payload) || !action.ParseFromString(response.extension()) ||
      !event.ParseFromString(action.events())) {
    return std::nullopt;
  }
  common::Payload payload;
  protos::Transaction transaction;
  protos::ChaincodeActionPayload action_payload;
  if (!payload.ParseFromString(tx.payload) || !transaction.ParseFromString(payload.data()) ||
      transaction.actions_size() != 1 || !action_payload.ParseFromString(transaction.actions(0).payload())) {
    return std::nullopt;
  }
  const crypto::Digest hash = crypto::sha256(payload.header().channel_header() + payload.header().signature_header() +
                                             action_payload.chaincode_proposal_payload());
  const std::string_view expected(reinterpret_cast<const char*>(hash.data()), hash.size());
  return EndorsedResult{.contract = event.chaincode_id(), .of_this_proposal = response.proposal_hash() == expected};
}

}  // namespace ledgerline::agent
