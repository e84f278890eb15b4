#include "onboard/agent/core/transaction_check.hpp"

#include <algorithm>

#include "common/common.pb.h"
#include "common/fabric/tx/form.hpp"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::agent {
namespace {

/// Whether the result that the endorsers signed is that of the transaction's own proposal, which names creator and
/// call: else a result endorsed for somebody else could be put into one's own transaction. Fabric's peers check the
/// same; this check does not lean on them. As Fabric's protoutil.GetProposalHash2. False for malformed bytes.
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

}  // namespace

RefusalReason TransactionCheck::check_creator(std::optional<std::int64_t> now_s, const fabric::Transaction& tx,
                                              access::Caller& signer) const {
  if (tx.channel != where_.channel || tx.contract != where_.contract) return RefusalReason::wrong_channel;
  const auto creator = registry_.member(tx.creator, now_s);
  if (!creator) return RefusalReason::unknown_signer;
  if (!fabric::verify_signature(tx, *(*creator)->verifier)) return RefusalReason::bad_signature;
  signer = {(*creator)->name, (*creator)->admin};
  return RefusalReason::none;
}

RefusalReason TransactionCheck::check(std::int64_t now_s, const fabric::Transaction& tx,
                                      const verification::Organisations& endorsers, access::Caller& signer) const {
  const RefusalReason why = check_creator(now_s, tx, signer);
  return why != RefusalReason::none || is_endorsed_by(endorsers, now_s, tx) ? why : RefusalReason::not_endorsed;
}

bool TransactionCheck::is_endorsed_by(const verification::Organisations& organisations,
                                      std::optional<std::int64_t> now_s, const fabric::Transaction& tx) const {
  if (!result_is_of_own_proposal(tx)) return false;
  return std::any_of(tx.endorsements.begin(), tx.endorsements.end(), [&](const fabric::Endorsement& e) {
    const auto endorser = registry_.member(e.endorser, now_s);
    // Peers alone: any other member of the organisation, this agent included, could sign a result of its own making.
    return endorser && (*endorser)->peer && organisations.contains((*endorser)->name.msp_id) &&
           fabric::verify_signature(tx, e, *(*endorser)->verifier);
  });
}

}  // namespace ledgerline::agent
