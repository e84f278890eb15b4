#include <utility>

#include "common/base/log.hpp"
#include "common/bridge/shell/bridges.hpp"
#include "common/dds/dds.hpp"
#include "common/fabric/config.hpp"
#include "common/fabric/tls/certificate_watch.hpp"
#include "common/program/program.hpp"

namespace {

using namespace ledgerline;

int carry(const bridge::BridgeConfig& carried, const dds::ParticipantOptions& dds, const fabric::ClientConfig& ledger,
          crypto::MspRegistry& trusted) {
  bridge::warn_of_open_topics(carried);
  auto participant = dds::Participant::create(dds);
  if (!participant) return fail(participant.error());
  auto bridges = bridge::Bridges::create(carried, {ledger}, trusted, *participant);
  if (!bridges) return fail(bridges.error(), exit_usage);  // of files that the config names
  return exit_code((*bridges)->run(stop_requested, [ready = false](const std::string& status) mutable {
    if (!std::exchange(ready, true)) print_line(R"({"ready":true,"program":"ledgerline-bridge"})");
    print_line(status);
  }));
}

int run(Config& config) {
  auto ledger = fabric::ledger_config(config);
  auto trusted = fabric::msp_registry(config);
  const bridge::BridgeConfig carried = bridge::read_bridge(config);
  const dds::ParticipantOptions dds = dds::participant_options(config, "ledgerline_bridge");
  Status checked = config.finish();
  if (checked && !carried.carries_something()) checked = Error{"no [[topic]] is named"};
  if (checked && !ledger) checked = ledger.error();
  if (checked && !trusted) checked = trusted.error();
  if (!checked) return fail(checked.error(), exit_usage);
  const auto certificates = fabric::watch_certificates(config, *ledger);
  if (!certificates) return fail(certificates.error(), exit_usage);
  (*certificates)->start(fabric::CertificateWatch::log);
  return carry(carried, dds, *ledger, **trusted);
}

const char* const about =
    "Carries ROS 2 topics of any type through the ledger, in either direction, as the config says. Ends on SIGINT and\n"
    "SIGTERM; `ledgerline topics` shows what each topic costs and loses.";

const std::string notes =
    R"(Examples:
  ledgerline bridge bridge.toml
  ROS_DOMAIN_ID=7 ledgerline bridge bridge.toml

bridge.toml:
)" + ledger_table_help +
    topic_tables_help + dds_table_help +
    R"(A status line (JSON) comes on standard output every [output] status_period_ms, and into the file [output] status.
[output] checkpoint is the file that a start goes on from, so that no peer shows it an older chain.
Exit codes: 0 ended by a signal; 1 DDS or ledger not reached, or a file not written; 2 bad usage or config)";

}  // namespace

int main(int argc, char** argv) { return run_with_config(argc, argv, {"ledgerline-bridge", about, notes}, run); }
