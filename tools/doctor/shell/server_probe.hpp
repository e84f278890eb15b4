#pragma once
#include <chrono>
#include <string>

#include "tools/doctor/core/server.hpp"
#include "tools/doctor/shell/configs.hpp"

namespace ledgerline::doctor {

/// Resolves, connects, and shakes hands by TLS with any server; then says hello in HTTP/2, since a server that wants a
/// certificate from its clients says so only then. Nothing is asked of the ledger. Each step takes `timeout` at most.
ServerFacts look_at_server(const ServerKeys& keys, const std::string& what, std::chrono::milliseconds timeout);

}  // namespace ledgerline::doctor
