#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <utility>

#include "common/base/log.hpp"
#include "common/bridge/shell/bridges.hpp"
#include "common/dds/settings/config.hpp"
#include "common/fabric/config.hpp"
#include "common/program/stop_signals.hpp"

namespace {

using namespace ledgerline;

constexpr int exit_usage = 2;

Status carry(const bridge::BridgeConfig& carried, const dds::ParticipantOptions& dds,
             const fabric::ClientConfig& ledger, crypto::MspRegistry& believed) {
  bridge::warn_of_open_topics(carried);
  auto participant = dds::Participant::create(dds);
  if (!participant) return participant.error();
  auto bridges = bridge::Bridges::create(carried, ledger, believed, *participant);
  if (!bridges) return bridges.error();
  return (*bridges)->run(stop_requested, [ready = false](const std::string& status) mutable {
    if (!std::exchange(ready, true)) fmt::print("{{\"ready\":true,\"program\":\"ledgerline-bridge\"}}\n");
    fmt::print("{}\n", status);
    std::fflush(stdout);
  });
}

int run(Config& config) {
  auto ledger = fabric::ledger_config(config);
  auto believed = fabric::msp_registry(config);
  const bridge::BridgeConfig carried = bridge::read_bridge(config);
  const dds::ParticipantOptions dds = dds::participant_options(config, "ledgerline_bridge");
  Status checked = config.finish();
  if (checked && !carried.carries_something()) checked = Error{"no [[topic]] is named"};
  if (checked && !ledger) checked = ledger.error();
  if (checked && !believed) checked = believed.error();
  if (!checked) {
    spdlog::error("{}", checked.error().what);
    return exit_usage;
  }
  if (auto status = carry(carried, dds, *ledger, **believed); !status) {
    spdlog::error("{}", status.error().what);
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Carries ROS 2 topics of any type through the ledger, in either direction, as the config says. Ends on SIGINT "
      "and\n"
      "SIGTERM; `ledgerline topics` shows what each topic costs and loses.",
      "ledgerline-bridge"};
  app.footer(
      "Examples:\n  ledgerline bridge bridge.toml\n  ROS_DOMAIN_ID=7 ledgerline bridge bridge.toml\n\n"
      "bridge.toml: [ledger] endpoint, tls_ca, msp_id, msp_dir; [[orderer]], [[peer]] endpoint, tls_ca; [[msp]] id, "
      "ca;\n"
      "  [[topic]] name (\"/a/b\", * stands for any characters), and with defaults\n"
      "    type (any), direction (both|to_ledger|from_ledger), from (first segment of the ids that are taken from\n"
      "    the ledger, must be given; \"*\": anybody's), channel,\n"
      "    keep (all|latest), latched, stream, rate_hz, every, priority (0-9, 5), queue (256), reliable, depth\n"
      "  [[enrolled]] name: enrolled to this identity; topics below /NAME/ have the id NAME/... on the ledger, all "
      "others\n"
      "    MSPID/...\n"
      "  [bridge] name, min_gap_ms; [dds] domain (ROS_DOMAIN_ID), local_only or cyclonedds, and for DDS Security\n"
      "    identity_ca, certificate, private_key, governance, permissions; [output] status, status_period_ms\n"
      "A status line (JSON) comes on standard output every status_period_ms, and into the file [output] status.\n"
      "Exit codes: 0 ended by a signal; 1 DDS or ledger not reached, or a file not written; 2 bad usage or config");
  std::string file;
  app.add_option("CONFIG", file, "TOML file")->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? EXIT_SUCCESS : exit_usage;
  }
  init_log("bridge");
  catch_stop_signals();
  auto config = Config::load(file);
  if (!config) {
    spdlog::error("{}", config.error().what);
    return exit_usage;
  }
  return run(*config);
}
