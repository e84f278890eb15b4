#pragma once
#include <string>

#include "common/rt/clock.hpp"

namespace ledgerline::ground::service {

/// [service] of ground.toml.
struct ServiceSettings {
  std::string listen;      ///< "127.0.0.1:8800"; empty: no service
  std::string token_file;  ///< 64 hex digits, mode 0600; made where it is missing
  std::string operators;   ///< folder of the operators' identities; empty: ground's own signs all
  TimeNs session_idle_ns = 0;
};

}  // namespace ledgerline::ground::service
