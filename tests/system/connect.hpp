#pragma once
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>

#include "common/config/config.hpp"
#include "common/fabric/calls/repeat.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/verification/calls.hpp"

namespace ledgerline {

/// For programs that tests drive: what the file says, or the program's end.
template <typename T>
T or_end(const std::string& path, Result<T> made) {
  if (made) return std::move(*made);
  std::fprintf(stderr, "%s: %s\n", path.c_str(), made.error().message.c_str());
  std::exit(1);
}

/// The [ledger] of a config file.
inline fabric::ClientConfig ledger_of(const std::string& path) {
  auto config = Config::load(path);
  return or_end(path, config ? fabric::ledger_config(*config) : Result<fabric::ClientConfig>(config.error()));
}

/// A client of the contract, of a config file with [ledger].
inline std::unique_ptr<fabric::Client> connect(const std::string& path) {
  return or_end(path, fabric::Client::create(verification::for_contract(ledger_of(path))));
}

/// How often the call was made until it was on the ledger; 0: it was refused or given up.
inline int submit_until_committed(fabric::Client& client, const fabric::Call& call) {
  fabric::Repeat repeat({}, 1, monotonic_ns());
  while (true) {
    const fabric::Outcome outcome = client.submit_and_wait(call);
    const auto next = repeat.ended(monotonic_ns(), outcome);
    if (next == fabric::Repeat::Next::on_ledger) return repeat.attempts();
    if (next != fabric::Repeat::Next::again) {
      std::fprintf(stderr, "%s: %s\n", call.function.c_str(), outcome.message.c_str());
      return 0;
    }
    std::this_thread::sleep_for(std::chrono::nanoseconds(std::max<TimeNs>(0, repeat.at_ns() - monotonic_ns())));
  }
}

}  // namespace ledgerline
