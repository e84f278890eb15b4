#pragma once
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>

#include "common/belief/client.hpp"
#include "common/config/config.hpp"
#include "common/fabric/config.hpp"

namespace ledgerline {

/// For programs that tests drive: what the file says, or the program's end.
template <typename T>
T or_end(const std::string& path, Result<T> made) {
  if (made) return std::move(*made);
  std::fprintf(stderr, "%s: %s\n", path.c_str(), made.error().what.c_str());
  std::exit(1);
}

/// The [ledger] of a config file.
inline fabric::ClientConfig ledger_of(const std::string& path) {
  auto config = Config::load(path);
  return or_end(path, config ? fabric::ledger_config(*config) : Result<fabric::ClientConfig>(config.error()));
}

/// A client of the contract, of a config file with [ledger].
inline std::unique_ptr<fabric::Client> connect(const std::string& path) {
  return or_end(path, fabric::Client::create(belief::for_contract(ledger_of(path))));
}

}  // namespace ledgerline
