#pragma once
#include <functional>
#include <string>
#include <vector>

#include "common/fabric/client/client.hpp"
#include "common/fabric/client/repeat.hpp"
#include "common/verification/calls.hpp"

namespace ledgerline::verification {

/// A client of the contract asks those to endorse whose keys the call writes (endorsement_need, or the call itself),
/// and signs no result whose event is not what it asked for (check_event).
inline fabric::ClientConfig for_contract(fabric::ClientConfig config) {
  config.contract_rules.endorsement_need = [](const fabric::Call& call) { return endorsement_need(call.function); };
  config.contract_rules.likely_policy = [](const std::string& key) { return likely_policy(key); };
  config.contract_rules.is_of_hot_path = [](const std::string& key) { return is_of_hot_path(key); };
  config.contract_rules.event_check = [](const fabric::Call& call, std::string_view event, std::string_view payload) {
    return check_event({call.function, call.args}, event, payload);
  };
  return config;
}

/// submit_repeatedly() for calls of the contract: where another transaction was first, the drones are claimed for a
/// function that claims let through (contract::is_claimed_for), so that a client that floods the ledger does not keep
/// it off. Who may not claim goes on without. A claim is ended with the call, or the log says that it may stand. Waits;
/// any thread.
fabric::Outcome submit_claiming(fabric::Client& client, const fabric::Call& call,
                                const std::vector<std::string>& drones, const fabric::RepeatLimits& limits,
                                const std::function<void(const fabric::Outcome&)>& on_first_failure);

}  // namespace ledgerline::verification
