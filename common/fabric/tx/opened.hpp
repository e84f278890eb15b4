#pragma once
#include <string>
#include <string_view>

#include "common/base/result.hpp"
#include "common/common.pb.h"
#include "peer/chaincode.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"

namespace ledgerline::fabric {

/// An endorser transaction with its layers opened, each inside the one before: for who compares it with what was asked
/// for, or changes it. A layer that was changed is in the bytes once it is sealed.
struct OpenedTransaction {
  common::Envelope envelope;
  common::Payload payload;
  protos::Transaction transaction;  ///< of one action
  protos::ChaincodeActionPayload action;
  protos::ProposalResponsePayload response;  ///< what endorsements sign
  protos::ChaincodeAction result;            ///< with a protos.ChaincodeEvent, or none

  /// The result into the response, and that into the action: to be endorsed then.
  void seal_result();
  /// A common.Envelope of all layers as they are now. Nothing is signed again.
  std::string bytes();
};
/// `envelope`: common.Envelope, signed or not.
Result<OpenedTransaction> open_transaction(std::string_view envelope);

}  // namespace ledgerline::fabric
