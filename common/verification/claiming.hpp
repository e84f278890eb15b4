#pragma once
#include <functional>
#include <string>
#include <vector>

#include "common/fabric/client/repeated.hpp"

namespace ledgerline::verification {

/// submit_repeatedly() for calls of the contract: where another transaction was first, the drones are claimed for a
/// function that claims let through (contract::is_claimed_for), so that a client that floods the ledger does not keep
/// it off. Who may not claim goes on without. A claim is ended with the call, or the log says that it may stand. Waits;
/// any thread.
fabric::Outcome submit_claiming(fabric::Client& client, const fabric::Call& call,
                                const std::vector<std::string>& drones, const fabric::RepeatLimits& limits,
                                const std::function<void(const fabric::Outcome&)>& on_first_failure);

}  // namespace ledgerline::verification
