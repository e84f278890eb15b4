#pragma once
#include <google/protobuf/timestamp.pb.h>

#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/common.pb.h"
#include "common/fabric/tx/transaction.hpp"
#include "peer/chaincode.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"
#include "peer/transaction.pb.h"

/// Transactions and blocks as Fabric's messages, for those who take them apart or change them.
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

Result<Block> decode_block(const common::Block& block);
/// What a peer has flagged each transaction with (protos.TxValidationCode, a byte each), as long as `block` lives;
/// empty: nothing, as in an orderer's block.
std::string_view flags_of(const common::Block& block);
/// block_header_hash of it.
std::string header_hash(const common::BlockHeader& header);
/// SHA-256 over all envelopes, one behind the other: what the header says of them.
std::string data_hash(const common::BlockData& data);

}  // namespace ledgerline::fabric
