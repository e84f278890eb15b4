#include "common/fabric/client/client.hpp"
#include "common/base/log.hpp"
#include "common/fabric/client/submit_repeatedly.hpp"
#include "common/msg/contract.hpp"
#include "common/verification/calls.hpp"
#include "ledgerline.pb.h"

namespace ledgerline::verification {

using Kind = fabric::Outcome::Kind;

fabric::ClientConfig for_contract(fabric::ClientConfig config) {
  config.contract_rules.endorsement_need = [](const fabric::Call& call) { return endorsement_need(call.function); };
  config.contract_rules.likely_policy = [](const std::string& key) { return likely_policy(key); };
  config.contract_rules.is_of_hot_path = [](const std::string& key) { return is_of_hot_path(key); };
  config.contract_rules.event_check = [](const fabric::Call& call, std::string_view event, std::string_view payload) {
    return check_event({call.function, call.args}, event, payload);
  };
  return config;
}

fabric::Outcome submit_claiming(fabric::Client& client, const fabric::Call& call,
                                const std::vector<std::string>& drones, const fabric::RepeatLimits& limits,
                                const std::function<void(const fabric::Outcome&)>& on_first_failure) {
  DronesCall claimed;
  for (const std::string& drone : drones) claimed.add_drones(drone);
  const auto change_claim = [&](const char* function) {
    return client.submit_and_wait({function, {claimed.SerializeAsString()}}).kind;
  };
  bool may_stand = false;
  fabric::Outcome outcome = fabric::submit_repeatedly(client, call, limits, [&](const fabric::Outcome& first) {
    if (on_first_failure) on_first_failure(first);
    may_stand = contract::is_claimed_for(call.function) && change_claim(contract::claim) != Kind::refused;
  });
  if (!may_stand || outcome.kind == Kind::committed) return outcome;  // what is on the ledger has ended the claim
  const Kind ended = change_claim(contract::unclaim);                 // refused: it ended with the caller's lease
  if (ended != Kind::committed && ended != Kind::refused)
    spdlog::error("{}: the drones may stay claimed; end that by {}", call.function, contract::unclaim);
  return outcome;
}

}  // namespace ledgerline::verification
