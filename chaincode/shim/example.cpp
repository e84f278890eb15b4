#include <csignal>
#include <cstdio>

#include "chaincode/shim/shim.hpp"

/// A counter as chaincode: "add" counts a key up and emits an event, "read" gives its value.
///
///     CHAINCODE_ID=counter:1234 CHAINCODE_SERVER_ADDRESS=127.0.0.1:9999 shim_example
namespace {

using namespace ledgerline;

shim::Response count(shim::Stub& stub) {
  const auto& args = stub.args();
  if (args.size() != 2) return {500, "give a function, add or read, and a key", ""};
  const auto stored = stub.get_state(args[1]);
  if (!stored) return {500, stored.error().what, ""};
  const int value = *stored ? std::atoi((*stored)->c_str()) : 0;
  if (args[0] == "read") return {200, "", std::to_string(value)};
  if (args[0] != "add") return {500, "unknown function " + args[0], ""};
  if (Status status = stub.put_state(args[1], std::to_string(value + 1)); !status)
    return {500, status.error().what, ""};
  stub.set_event("added", args[1]);
  return {200, "", std::to_string(value + 1)};
}

}  // namespace

int main() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  const auto options = shim::options_from_environment();
  if (!options) return std::fprintf(stderr, "%s\n", options.error().what.c_str()), 2;
  const auto server = shim::Server::start(*options, count);
  if (!server) return std::fprintf(stderr, "%s\n", server.error().what.c_str()), 1;
  int signal = 0;
  sigwait(&signals, &signal);
  (*server)->stop();
}
