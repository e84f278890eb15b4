#pragma once
#include <string>

namespace ledgerline::ground::service {

/// [service] of ground.toml.
struct ServiceSettings {
  std::string listen;      ///< "127.0.0.1:8800"; empty: no service
  std::string token_file;  ///< 64 hex digits, mode 0600; made where it is missing
};

}  // namespace ledgerline::ground::service
