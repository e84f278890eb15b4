#pragma once
#include <optional>
#include <string>

#include "chaincode/contract/stub.hpp"
#include "chaincode/node/core/ledger/ledger.hpp"
#include "chaincode/node/core/tx/proposal.hpp"

/// The contracts that every peer of Fabric has of its own, as far as tools ask them: qscc (the chain) and cscc (the
/// channels). They answer questions. A peer signs what they say of the channel; no transaction can be made of it.
namespace ledgerline::node {

bool is_system_contract(const std::string& contract);

/// What such a contract says; nullopt: the proposal is for none of them.
std::optional<chaincode::Response> ask_system_contract(const Ledger& ledger, const std::string& channel,
                                                       const ProposalParts& proposal);

}  // namespace ledgerline::node
