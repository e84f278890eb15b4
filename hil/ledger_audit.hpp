#pragma once
#include <string>
#include <vector>

namespace ledgerline::hil {

/// Which of these transactions are not in the blocks as valid ones, in words.
std::vector<std::string> missing_transactions(const std::vector<std::string>& blocks,
                                              const std::vector<std::string>& acknowledged);

/// Transitions of the failsafe whose numbers do not follow each other on the ledger, in words: of each drone and start
/// of its link.
std::vector<std::string> transition_gaps(const std::vector<std::string>& blocks);

}  // namespace ledgerline::hil
