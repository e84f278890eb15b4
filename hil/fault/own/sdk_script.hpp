#pragma once
#include <vector>

#include "hil/fault/real/real_script.hpp"

namespace ledgerline::hil {

/// All that an SDK client's flight cannot have of this script: there is no link, agent, ground or ledger in it, and the
/// proxy alone does faults to the drones.
std::vector<NotReal> not_by_sdk(const Script& script);
/// The same as an error, a line each.
Status check_sdk(const Script& script);

}  // namespace ledgerline::hil
