#include "onboard/agent/core/proposal_hash.hpp"

#include "common/common.pb.h"
#include "common/fabric/tx/form.hpp"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::agent {

bool result_is_of_own_proposal(const fabric::Transaction& tx) {
  protos::ProposalResponsePayload response;
  common::Payload payload;
  protos::Transaction transaction;
  protos::ChaincodeActionPayload action;
  if (!response.ParseFromString(tx.response_payload) || !payload.ParseFromString(tx.payload) ||
      !transaction.ParseFromString(payload.data()) || transaction.actions_size() != 1 ||
      !action.ParseFromString(transaction.actions(0).payload())) {
    return false;
  }
  return response.proposal_hash() == fabric::proposal_hash(payload.header().channel_header(),
                                                           payload.header().signature_header(),
                                                           action.chaincode_proposal_payload());
}

}  // namespace ledgerline::agent
