#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "chaincode/node/core/types.hpp"
#include "common/base/result.hpp"
#include "common/common.pb.h"
#include "common/fabric/tx/form.hpp"
#include "ledger/rwset/kvrwset/kv_rwset.pb.h"
#include "peer/chaincode_event.pb.h"
#include "peer/proposal.pb.h"
#include "peer/proposal_response.pb.h"

/// Proposals, transactions and blocks as Fabric lays them out: taken apart, checked for form, and made.
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
/// Which contract and function a transaction asked for, by its ChaincodeProposalPayload. nullopt: it does not parse.
struct CalledFunction {
  std::string contract, function;
};
std::optional<CalledFunction> read_called(const std::string& proposal_payload);
Result<ProposalParts> read_proposal(std::string_view proposal_bytes);

/// The same with its creator's signature, of which nothing is checked either.
struct SignedProposalParts {
  ProposalParts proposal;
  std::string proposal_bytes, signature;
};
Result<SignedProposalParts> read_signed_proposal(std::string_view signed_proposal);

/// The transaction's envelope, still unsigned.
std::string make_envelope(const ProposalParts& proposal, const std::string& response_payload,
                          const std::vector<protos::Endorsement>& endorsements);

/// The part of a transaction's read-write set that is the contract's own.
kvrwset::KVRWSet set_of(const fabric::ReadWriteSet& sets, const std::string& contract);

/// Where a chain ends, and so what the next block follows.
struct ChainEnd {
  std::uint64_t height = 0;
  std::string hash;  ///< of the last block's header; empty: there is none
};

/// Puts a block together, with room for signatures and flags.
common::Block make_block(const ChainEnd& end, const std::vector<std::string>& envelopes);
/// Adds the orderer's signature over the header.
Status sign_block(common::Block& block, const crypto::SigningIdentity& orderer);

/// The channel's configuration (organisations with their certificates, batch settings) as an envelope for block 0.
std::string make_config_envelope(const CoreConfig& config, const crypto::SigningIdentity& orderer);

}  // namespace ledgerline::node
