#pragma once
#include <string>

#include "common/msg/onboard.hpp"

namespace ledgerline::agent {

/// A drone of this host: its number in shared memory and its name on the ledger.
struct DroneName {
  DroneNumber number = 0;
  std::string name;
};

}  // namespace ledgerline::agent
