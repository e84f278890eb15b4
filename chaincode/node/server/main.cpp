#include <unistd.h>

#include <csignal>
#include <nlohmann/json.hpp>

#include "chaincode/node/server/services.hpp"
#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/fabric/channels.hpp"
#include "common/fabric/tls/tls_server.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/rt/histogram.hpp"

namespace {

using namespace ledgerline;

constexpr const char* notes = R"(
Examples:
  ledgerline-node --dir /tmp/ledger --listen 127.0.0.1:7051
  ledgerline-node --dir /tmp/ledger --listen 127.0.0.1:0 --batch-timeout 10 --batch-count 10
  ledgerline-node --dir /tmp/ledger --listen 10.0.0.2:7051 --tls-client-ca org1.pem --tls-client-ca org2.pem
  cp -r /tmp/ledger/crypto /tmp/yard && ledgerline-node --dir /tmp/yard --channel yard --listen 127.0.0.1:7061

Serves Fabric's gateway, endorser, deliver and ordering over TLS, for one channel and contract ledgerline. The first start
makes three organisations under DIR/crypto (cryptogen's layout), enrolls the drones to Org1's User1 and makes Org2's User1 an
operator. Prints {"ready":true,"endpoint":...,"peers":[...]} when it serves: `peers` are the endpoints of the
three organisations' peers, the first of which is `endpoint` and serves everybody. SIGINT or SIGTERM ends it.
Exit codes: 0 ended by a signal, 1 failed, 2 wrong usage.)";

Status write_summary(const std::string& path, const node::Node& ledger, const std::string& storage) {
  const node::NodeCore::Counts counts = ledger.counts();
  const nlohmann::json summary{{"blocks", counts.blocks},
                               {"transactions", counts.transactions},
                               {"invalid", counts.invalid},
                               {"storage", storage},
                               {"disk_ms", ledger.disk_ms()}};
  return write_file(path, summary.dump(2) + "\n");
}

}  // namespace

int main(int argc, char** argv) {
  CommandLine line("ledgerline-node", "The embedded ledger: one process with Fabric's services", notes);
  node::Node::Options options;
  std::string listen, summary;
  std::vector<std::string> client_authorities;
  double batch_timeout_ms = 10;
  line.option("--dir", options.dir, "Where identities and the ledger live").required();
  line.option("--listen", listen, "Where it serves; port 0 takes a free one")
      .required()
      .checked_by("ADDRESS:PORT", [](const std::string& text) {
        const Status checked = check_endpoint(text, 0);
        return checked ? std::string() : checked.error().message;
      });
  line.option("--tls-client-ca", client_authorities,
              "PEM file of an authority whose certificates clients must show (mutual TLS); more than once; none: they "
              "need none")
      .one_at_a_time();
  line.option("--channel", options.core.channel, "The channel's name; of a ledger that is there, as it was")
      .shows_default();
  line.option("--drone", options.drones, "A drone that a new ledger enrolls; more than once; none: tello1 to tello16")
      .one_at_a_time();
  line.option("--batch-timeout", batch_timeout_ms, "Cut a block after this many ms")
      .within(0.0, 60000.0)
      .shows_default();
  line.option("--batch-count", options.core.batch_count, "or with this many transactions")
      .within(1, 10000)
      .shows_default();
  line.option("--batch-bytes", options.core.batch_bytes, "or this many bytes").within(1, 100'000'000).shows_default();
  line.option("--summary", summary, "Write a JSON summary here at the end");
  if (const auto end = line.parse(argc, argv)) return *end;
  if (!fabric::is_channel_name(options.core.channel))
    return fail(Error{"--channel: a channel's name is a-z first, then a-z, 0-9, . and -"}, exit_usage);
  options.core.batch_timeout_ns = static_cast<TimeNs>(batch_timeout_ms * ns_per_ms);

  auto authorities = fabric::read_client_authorities(client_authorities);
  if (!authorities) return fail(Error{"--tls-client-ca: " + authorities.error().message}, exit_usage);
  // Before any thread is made, so that all inherit it and the signal waits for us below.
  const sigset_t signals = block_signals({SIGINT, SIGTERM, SIGUSR1});
  outlive_readers();
  const std::string dir = options.dir;
  auto opened = node::Node::open(std::move(options));
  if (!opened) return fail(opened.error());
  node::Node& ledger = **opened;
  const auto storage = node::storage_kind(dir);
  if (!storage) return fail(storage.error());
  ledger.on_failure([](const std::string&) { ::kill(::getpid(), SIGUSR1); });
  auto server = node::Server::start(ledger, listen, std::move(*authorities));
  if (!server) return fail(server.error());
  const std::string endpoint = (*server)->endpoint();
  print_line(nlohmann::json{
      {"ready", true}, {"endpoint", endpoint}, {"peers", (*server)->endpoints()}, {"orderers", {endpoint}}}
                 .dump());

  int signal = 0;
  sigwait(&signals, &signal);
  (*server)->stop();
  ledger.stop();
  if (!summary.empty()) {
    if (Status status = write_summary(summary, ledger, *storage); !status) return fail(status.error());
  }
  return signal == SIGUSR1 ? 1 : 0;
}
