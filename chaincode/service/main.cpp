#include <pthread.h>
#include <signal.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "chaincode/service/contract_stub.hpp"
#include "common/base/log.hpp"
#include "common/rt/histogram_json.hpp"

namespace {

using namespace ledgerline;

constexpr const char* examples = R"(
Started as chaincode services are:
  CHAINCODE_ID=ledgerline_1:HASH CHAINCODE_SERVER_ADDRESS=127.0.0.1:9999 ledgerline-chaincode
With TLS (files): CHAINCODE_TLS_KEY, CHAINCODE_TLS_CERT; with CHAINCODE_TLS_CLIENT_CA peers must show a certificate.

The contract of Ledgerline for Fabric's peers: the same code that the embedded node runs. One process an organisation.
Prints {"ready":true,"endpoint":...} when it serves. SIGINT or SIGTERM ends it.
Exit codes: 0 ended by a signal, 1 failed, 2 wrong usage.)";

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Ledgerline's contract as a chaincode service"};
  app.footer(examples);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  init_log("chaincode");
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  const auto options = shim::options_from_environment();
  if (!options) {
    spdlog::error("{}", options.error().what);
    return 2;
  }
  const auto server = shim::Server::start(*options, chaincode::invoke_on_fabric);
  if (!server) {
    spdlog::error("{}", server.error().what);
    return 1;
  }
  std::printf("%s\n", nlohmann::json{{"ready", true}, {"endpoint", (*server)->endpoint()}}.dump().c_str());
  std::fflush(stdout);
  int signal = 0;
  sigwait(&signals, &signal);
  (*server)->stop();
}
