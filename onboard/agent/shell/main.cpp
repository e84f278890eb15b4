#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <set>

#include "common/base/log.hpp"
#include "common/belief/client.hpp"
#include "common/bridge/shell/bridges.hpp"
#include "common/dds/settings/config.hpp"
#include "common/fabric/config.hpp"
#include "common/program/stop_signals.hpp"
#include "onboard/agent/shell/shell.hpp"

namespace {

using namespace ledgerline;

constexpr int exit_usage = 2;

Status check_drones(const std::vector<agent::DroneName>& drones) {
  std::set<DroneNumber> numbers;
  std::set<std::string> names;
  for (const agent::DroneName& drone : drones) {
    if (!numbers.insert(drone.number).second || !names.insert(drone.name).second) {
      return Error{fmt::format("[[drone]] {}: its name or number is there twice", drone.name)};
    }
  }
  if (drones.empty()) return Error{"no [[drone]] is named"};
  return done;
}

/// Our own organisation must be among those that are believed: only its peers' endorsements count. Asks for the keys of
/// all [[msp]], so that finish() does not call those unknown that msp_registry did not reach.
Status check_own_msp(Config& config, const std::string& msp_id) {
  bool found = false;
  for (std::size_t i = 0; i < config.table_count("msp"); ++i) {
    (void)config.text(fmt::format("msp.{}.ca", i));
    found = config.text(fmt::format("msp.{}.id", i)) == msp_id || found;
  }
  if (found) return done;
  return Error{
      fmt::format("no [[msp]] has id = \"{}\": without our own organisation no command could be believed", msp_id)};
}

int run(Config& config) {
  // What a leader that died took with it is given up soon: newer states say more.
  auto ledger = fabric::ledger_config(config, std::chrono::seconds(1));
  auto registry = fabric::msp_registry(config);
  const fabric::ClientConfig known = belief::with_event_check(ledger ? *ledger : fabric::ClientConfig{});
  agent::Settings settings = agent::read_settings(config, known.identity.name.msp_id, known.where);
  const bridge::BridgeConfig bridged = agent::read_bridge(config, settings.core.drones);
  const dds::ParticipantOptions dds = dds::participant_options(config, "ledgerline_agent");
  if (settings.core.seed == 0) settings.core.seed = static_cast<std::uint64_t>(realtime_ns());
  const Status own_msp = check_own_msp(config, known.identity.name.msp_id);
  Status checked = config.finish();
  if (checked) checked = check_drones(settings.core.drones);
  if (checked && !ledger) checked = ledger.error();
  if (checked && !registry) checked = registry.error();
  if (checked) checked = own_msp;
  if (!checked) {
    spdlog::error("{}", checked.error().what);
    return exit_usage;
  }
  auto client = fabric::Client::create(known);
  auto urgent = fabric::Client::create(known);
  if (!client || !urgent) {
    spdlog::error("{}", (client ? urgent : client).error().what);
    return exit_usage;
  }
  dds::ParticipantPtr participant;
  if (!settings.mocap_topic.empty() || bridged.carries_something()) {
    auto made = dds::Participant::create(dds);
    if (!made) {
      spdlog::error("{}", made.error().what);
      return EXIT_FAILURE;
    }
    participant = std::move(made).value();
  }
  agent::AgentShell shell(std::move(settings), std::move(registry).value(), std::move(client).value(),
                          std::move(urgent).value(), participant, stop_requested);
  if (auto status = shell.start(); !status) {
    spdlog::error("{}", status.error().what);
    return EXIT_FAILURE;
  }
  const auto bridges = bridge::BesideBridges::create(config, bridged, participant);
  if (!bridges) {
    spdlog::error("{}", bridges.error().what);
    return EXIT_FAILURE;
  }
  fmt::print("{{\"ready\":true,\"program\":\"ledgerline-agent\"}}\n");
  std::fflush(stdout);
  if (auto status = shell.run(); !status) {
    spdlog::error("{}", status.error().what);
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Talks to the ledger for the drones of this host: states from link go out in frames, commands come back in\n"
      "blocks, are checked, and go to link as plans; mocap becomes pose and velocity.",
      "ledgerline-agent"};
  app.footer(
      "Example:\n  ledgerline-agent --config agent.toml\n\n"
      "agent.toml: [ledger] endpoint, tls_ca, msp_id, msp_dir, cross_check;\n"
      "          [[orderer]], [[peer]] endpoint, tls_ca; [[msp]] id, ca; [[drone]] name, number;\n"
      "  [output] trace, summary, status_period_ms; and with defaults\n"
      "  [mocap] topic, clock (host|arrival), position_sigma_m, acceleration_sigma_mps2, gate_sigma,\n"
      "          outliers_before_reset, longest_gap_ms, frozen_after_ms\n"
      "  [check] max_age_ms, max_speed_mps, max_yaw_rate_radps, horizon_ms, stamps_kept\n"
      "  [batch] min_gap_ms, linger_ms, freshness_ms, first_back_off_ms, longest_back_off_ms, refused_drone_pause_ms\n"
      "  [agent] beat_ms, ledger_silent_after_ms, seed, start_wait_s\n"
      "  [realtime] priority (SCHED_FIFO from block to plan, below link's 80; 0: ordinary)\n"
      "  [dds] domain (ROS_DOMAIN_ID), local_only or cyclonedds, and for DDS Security\n"
      "          identity_ca, certificate, private_key, governance, permissions\n"
      "  [[topic]], [[enrolled]], [bridge], [output] status: any ROS 2 topic, as `ledgerline bridge --help` has it\n"
      "A status line (JSON) comes on standard output every status_period_ms. SIGINT and SIGTERM end it.\n"
      "It ends by itself, too, when RouDi is gone and no drone of its link is in the air: start it behind a new "
      "RouDi.\n"
      "Exit codes: 0 ended by a signal or for a new RouDi; 1 RouDi or ledger not reached, or a file not written; 2 bad "
      "usage or config");
  std::string file;
  app.add_option("--config", file, "TOML file")->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : exit_usage;
  }
  init_log("agent");
  catch_stop_signals();
  auto config = Config::load(file);
  if (!config) {
    spdlog::error("{}", config.error().what);
    return exit_usage;
  }
  return run(*config);
}
