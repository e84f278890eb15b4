#pragma once
#include <string>
#include <vector>

#include "hil/sitl/ledger/ledger_port.hpp"

namespace ledgerline::hil {

/// Transitions of the failsafe whose numbers do not follow each other on the ledger, in words: of each drone and start
/// of its link.
std::vector<std::string> transition_gaps(const std::vector<std::string>& blocks);

/// Transactions that were reported to clients as committed, and that the ledger does not know, or not as valid: in
/// words.
std::vector<std::string> not_on_ledger(const SimulatedLedger& ledger, const std::vector<const LedgerPort*>& ports);

}  // namespace ledgerline::hil
