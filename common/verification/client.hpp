#pragma once
#include "common/fabric/client/client.hpp"
#include "common/verification/calls.hpp"

namespace ledgerline::verification {

/// A client of the contract asks those to endorse whose keys the call writes (endorsement_need, or the call itself),
/// and signs no result whose event is not what it asked for (check_event).
inline fabric::ClientConfig for_contract(fabric::ClientConfig config) {
  config.endorsement_need = [](const fabric::Call& call) { return endorsement_need(call.function); };
  config.likely_policy = [](const std::string& key) { return likely_policy(key); };
  config.is_of_hot_path = [](const std::string& key) { return is_of_hot_path(key); };
  config.event_check = [](const fabric::Call& call, std::string_view event, std::string_view payload) {
    return check_event({call.function, call.args}, event, payload);
  };
  return config;
}

}  // namespace ledgerline::verification
