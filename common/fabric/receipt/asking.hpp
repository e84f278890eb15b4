#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/receipt/receipt.hpp"

namespace ledgerline::fabric {

/// What was heard for a receipt.
struct ReceiptRequest {
  Receipt receipt;
  std::vector<std::string> unheard;  ///< peers that were not reached or refused, and why
};

/// Asks the ledger for all that a receipt of transaction `tx_id` is made of: the own peer for its block, and for the
/// verdict a peer of each organisation of `config.endorsers`, and the own one where none of those is of the own
/// organisation. Waits for each at most `config.deadline`. An error: there is no such transaction, no peer answers, or
/// the peers differ. One thread.
Result<ReceiptRequest> ask_receipt(ClientConfig config, const std::string& tx_id);

}  // namespace ledgerline::fabric
