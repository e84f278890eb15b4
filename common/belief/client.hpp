#pragma once
#include "common/belief/calls.hpp"
#include "common/fabric/client/client.hpp"

namespace ledgerline::belief {

/// A client of the contract signs no result whose event is not what it asked for (check_event).
inline fabric::ClientConfig with_event_check(fabric::ClientConfig config) {
  config.event_check = [](const fabric::Call& call, std::string_view event, std::string_view payload) {
    return check_event({call.function, call.args}, event, payload);
  };
  return config;
}

}  // namespace ledgerline::belief
