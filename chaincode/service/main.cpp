#include <cstdio>
#include <nlohmann/json.hpp>

#include "chaincode/service/contract_stub.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/rt/histogram.hpp"

namespace {

constexpr const char* notes = R"(
Started as chaincode services are:
  CHAINCODE_ID=ledgerline_1:HASH CHAINCODE_SERVER_ADDRESS=127.0.0.1:9999 ledgerline-chaincode
With TLS (files): CHAINCODE_TLS_KEY, CHAINCODE_TLS_CERT; with CHAINCODE_TLS_CLIENT_CA peers must show a certificate,
and with CHAINCODE_TLS_CLIENT_NAMES=peer0.org1.example.com,... one of these names must be in it.

The contract of Ledgerline for Fabric's peers: the same code that the embedded node runs. One process an organisation.
Prints {"ready":true,"endpoint":...} when it serves. SIGINT or SIGTERM ends it.
Exit codes: 0 ended by a signal, 1 failed, 2 wrong usage.)";

}  // namespace

int main(int argc, char** argv) {
  using namespace ledgerline;
  CommandLine line("ledgerline-chaincode", "Ledgerline's contract as a chaincode service", notes);
  if (const auto end = line.parse(argc, argv)) return *end;
  const sigset_t signals = block_signals();
  outlive_readers();
  auto options = shim::options_from_environment();
  if (!options) return fail(options.error(), exit_usage);
  auto id = shim::package_id_from(options->chaincode_id);
  if (!id) return fail(id.error(), exit_usage);
  options->chaincode_id = std::move(*id);
  const auto server = shim::Server::start(*options, chaincode::invoke_on_fabric);
  if (!server) return fail(server.error());
  print_line(nlohmann::json{{"ready", true}, {"endpoint", (*server)->endpoint()}}.dump());
  int signal = 0;
  sigwait(&signals, &signal);
  (*server)->stop();
}
