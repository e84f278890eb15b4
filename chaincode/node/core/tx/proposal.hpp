#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/common.pb.h"
#include "ledger/rwset/kvrwset/kv_rwset.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"

/// Proposals and transactions as Fabric lays them out: taken apart, checked for form, and made.
namespace ledgerline::node {

/// A proposal, taken apart. Nothing is checked but that it parses.
struct ProposalParts {
  common::Header header;
  common::ChannelHeader channel_header;
  common::SignatureHeader signature_header;
  std::string contract;
  std::string function;
  std::vector<std::string> args;
  std::string payload;  ///< ChaincodeProposalPayload without the transient map: what goes into the transaction
};
Result<ProposalParts> read_proposal(std::string_view proposal_bytes);

/// Hex SHA-256 of nonce and creator.
std::string transaction_id(const common::SignatureHeader& header);
/// What ties a response to its proposal.
std::string proposal_hash(const common::Header& header, std::string_view payload);

/// The transaction's envelope, still unsigned.
std::string make_envelope(const ProposalParts& proposal, const std::string& response_payload,
                          const std::vector<protos::Endorsement>& endorsements);

/// An endorser transaction in an envelope, taken apart. `code` is VALID, or what is wrong with its form.
struct TransactionParts {
  int code = 0;
  common::ChannelHeader channel_header;
  common::SignatureHeader signature_header;
  std::string response_payload;
  std::vector<protos::Endorsement> endorsements;
  protos::ChaincodeAction action;
};
TransactionParts read_transaction(std::string_view envelope);

/// The contract's part of a transaction's read-write set; an error says which rule it breaks as a TxValidationCode.
struct ContractSet {
  int code = 0;
  kvrwset::KVRWSet set;
};
ContractSet read_contract_set(const protos::ChaincodeAction& action, const std::string& contract);

}  // namespace ledgerline::node
