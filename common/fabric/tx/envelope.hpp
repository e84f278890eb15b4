#pragma once
#include <google/protobuf/timestamp.pb.h>

#include <string>
#include <vector>

#include "common/common.pb.h"
#include "common/fabric/tx/transaction.hpp"
#include "peer/proposal_response.pb.h"

namespace ledgerline::fabric {

/// A call as protos.Proposal, in the one form that it has here. `who`: creator and nonce, of which the transaction's id
/// is made. A receipt's question is identified by these bytes: another form would end the receipts that there are.
std::string proposal_bytes(const common::SignatureHeader& who, const ChannelAndContract& where, const Call& call,
                           const google::protobuf::Timestamp& time);

/// An endorser transaction as common.Envelope without signature. `payload`: the ChaincodeProposalPayload without its
/// transient map; `response_payload`: the ProposalResponsePayload that the endorsements sign.
std::string unsigned_envelope(const common::Header& header, const std::string& payload,
                              const std::string& response_payload,
                              const std::vector<protos::Endorsement>& endorsements);

}  // namespace ledgerline::fabric
