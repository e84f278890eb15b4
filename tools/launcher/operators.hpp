#pragma once
#include <string>
#include <vector>

#include "tools/launcher/configs.hpp"

namespace ledgerline::fly {

/// Somebody who signs in at a flight's page.
struct MadeOperator {
  std::string name;
  std::string certificate;  ///< file
  std::string pass_phrase;  ///< of his key; for the terminal alone
};

/// Makes an identity of Org2 for each of these names, by its CA's key that lies beside a ledger of the flight's own, as
/// an MSP folder in operators/ of the run.
Result<std::vector<MadeOperator>> make_operators(const RunFiles& files, const std::vector<std::string>& names);

/// What may be an operator's name: it is a folder and part of a subject.
bool is_operator_name(const std::string& name);

}  // namespace ledgerline::fly
