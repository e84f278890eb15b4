#pragma once
#include <optional>
#include <string>

#include "common/fabric/transaction.hpp"

namespace ledgerline::agent {

/// What the endorsers of a transaction signed, as far as fabric::Transaction does not say it.
struct EndorsedResult {
  std::string contract;           ///< whose event it is
  bool of_this_proposal = false;  ///< the hash in it is that of the transaction's own proposal (which names creator and
                                  ///< call), so it was not taken from another transaction
};
/// Nothing where a part is missing or malformed. Proposal hash: SHA-256 over channel header, signature header and
/// proposal payload, as Fabric's protoutil.GetProposalHash2.
std::optional<EndorsedResult> endorsed_result(const fabric::Transaction& tx);

}  // namespace ledgerline::agent
