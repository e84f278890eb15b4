#pragma once
#include <string>
#include <vector>

namespace ledgerline::hil {

/// Transitions of the failsafe whose numbers do not follow each other on the ledger, in words: of each drone and start
/// of its link.
std::vector<std::string> transition_gaps(const std::vector<std::string>& blocks);

}  // namespace ledgerline::hil
