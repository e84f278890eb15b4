#pragma once
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>

#include "common/belief/client.hpp"
#include "common/config/config.hpp"
#include "common/fabric/config.hpp"

namespace ledgerline {

/// A client of the contract, for a program that tests drive, of a config file with [ledger]; ends the program if there is
/// none.
inline std::unique_ptr<fabric::Client> connect(const std::string& path) {
  auto config = Config::load(path);
  auto ledger = config ? fabric::ledger_config(*config) : Result<fabric::ClientConfig>(config.error());
  auto client = ledger ? fabric::Client::create(belief::for_contract(std::move(*ledger))) : ledger.error();
  if (client) return std::move(*client);
  std::fprintf(stderr, "%s: %s\n", path.c_str(), client.error().what.c_str());
  std::exit(1);
}

}  // namespace ledgerline
