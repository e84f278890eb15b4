#pragma once
#include "common/fabric/tx/transaction.hpp"

namespace ledgerline::agent {

/// Whether the result that the endorsers signed is that of the transaction's own proposal, which names creator and
/// call: else a result endorsed for somebody else could be put into one's own transaction. Fabric's peers check the
/// same; this check does not lean on them. Hash: SHA-256 over channel header, signature header and proposal payload, as
/// Fabric's protoutil.GetProposalHash2. False for malformed bytes.
bool result_is_of_own_proposal(const fabric::Transaction& tx);

}  // namespace ledgerline::agent
