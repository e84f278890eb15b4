#include <csignal>
#include <cstdio>
#include <cstdlib>

#include "chaincode/shim/shim.hpp"

/// Counters as chaincode: "add KEY..." counts keys up and emits an event, "read KEY" gives a value, "list" all of them
/// in order, "past KEY" the values that it had, newest first, "remove KEY" ends one.
///
///     CHAINCODE_ID=counter:1234 CHAINCODE_SERVER_ADDRESS=127.0.0.1:9999 shim_example
namespace {

using namespace ledgerline;

constexpr std::size_t max_listed = 1000;  // counters, and values of one, that an answer shows

shim::Response refuse(const Error& why) { return {500, why.message, ""}; }

shim::Response add(shim::Stub& stub, const std::vector<std::string>& keys) {
  std::string counts;
  for (const std::string& key : keys) {
    const auto stored = stub.get_state(key);
    if (!stored) return refuse(stored.error());
    const std::string count = std::to_string((*stored ? std::atoi((*stored)->c_str()) : 0) + 1);
    if (Status status = stub.put_state(key, count); !status) return refuse(status.error());
    counts += (counts.empty() ? "" : " ") + count;
  }
  stub.set_event("added", counts);
  return {200, "", counts};
}

shim::Response count(shim::Stub& stub) {
  const auto& args = stub.args();
  const std::string function = args.empty() ? "" : args[0];
  if (function == "list") {
    const auto all = stub.get_range("", "", max_listed);
    if (!all) return refuse(all.error());
    std::string text;
    for (const auto& [key, value] : *all) text += key + "=" + value + "\n";
    return {200, "", text};
  }
  if (args.size() < 2) return {500, "give a function, add, read, list, past or remove, and a key", ""};
  if (function == "add") return add(stub, {args.begin() + 1, args.end()});
  if (function == "read") {
    const auto stored = stub.get_state(args[1]);
    if (!stored) return refuse(stored.error());
    return {200, "", stored->value_or("0")};
  }
  if (function == "past") {
    const auto values = stub.get_history(args[1], 0, max_listed);
    if (!values) return refuse(values.error());
    std::string text;
    for (const auto& one : *values) text += (one.is_delete ? "removed" : one.value) + "\n";
    return {200, "", text};
  }
  if (function == "remove") {
    const Status removed = stub.del_state(args[1]);
    return removed ? shim::Response{} : refuse(removed.error());
  }
  return {500, "unknown function " + function, ""};
}

}  // namespace

int main() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  const auto options = shim::options_from_environment();
  if (!options) return std::fprintf(stderr, "%s\n", options.error().message.c_str()), 2;
  const auto server = shim::Server::start(*options, count);
  if (!server) return std::fprintf(stderr, "%s\n", server.error().message.c_str()), 1;
  std::printf("%s\n", (*server)->endpoint().c_str());
  std::fflush(stdout);
  int signal = 0;
  sigwait(&signals, &signal);
  (*server)->stop();
}
