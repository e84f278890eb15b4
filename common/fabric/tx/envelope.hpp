#pragma once
#include <string>
#include <vector>

#include "common/common.pb.h"
#include "peer/proposal_response.pb.h"

namespace ledgerline::fabric {

/// An endorser transaction as common.Envelope without signature. `payload`: the ChaincodeProposalPayload without its
/// transient map; `response_payload`: the ProposalResponsePayload that the endorsements sign.
std::string unsigned_envelope(const common::Header& header, const std::string& payload,
                              const std::string& response_payload,
                              const std::vector<protos::Endorsement>& endorsements);

}  // namespace ledgerline::fabric
