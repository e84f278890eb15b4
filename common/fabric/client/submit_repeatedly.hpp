#pragma once
#include <functional>

#include "common/fabric/calls/repeat.hpp"

namespace ledgerline::fabric {
class Client;
struct Call;

/// Submits a call, and again as the limits say; waits until it is over. `on_first_failure` (may be null) gets the
/// reason for the second attempt. Where it is given up behind more than one attempt, the outcome's message says so.
Outcome submit_repeatedly(Client& client, const Call& call, const RepeatLimits& limits,
                          const std::function<void(const Outcome&)>& on_first_failure);

}  // namespace ledgerline::fabric
