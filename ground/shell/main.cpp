#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "common/base/log.hpp"
#include "common/belief/client.hpp"
#include "common/bridge/shell/bridges.hpp"
#include "common/dds/settings/config.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/program/stop_signals.hpp"
#include "ground/shell/ground.hpp"

namespace {

using namespace ledgerline;

constexpr int exit_usage = 2;

int fly(Config& config) {
  ground::FlightConfig flight = ground::flight_config(config);
  const ground::OutputSettings output = ground::output_settings(config);
  const bridge::BridgeConfig bridged = ground::read_bridge(config, flight.drones);
  const dds::ParticipantOptions dds = dds::participant_options(config, "ledgerline_ground");
  // What a leader that died took with it is given up soon: newer commands say more.
  auto ledger = fabric::ledger_config(config, std::chrono::seconds(1));
  auto believed = fabric::msp_registry(config);
  Status checked = config.finish();
  if (checked && flight.drones.empty()) checked = Error{"no [[drone]] to fly"};
  if (checked && !ledger) checked = ledger.error();
  if (checked && !believed) checked = believed.error();
  if (!checked) {
    spdlog::error("{}", checked.error().what);
    return exit_usage;
  }
  flight.self = ledger->identity.name;
  flight.believed = std::move(believed).value();
  flight.where = ledger->where;
  const fabric::ClientConfig careful = belief::with_event_check(std::move(ledger).value());
  auto client = fabric::Client::create(careful);
  auto urgent = fabric::Client::create(careful);
  if (!client || !urgent) {
    spdlog::error("{}", (client ? urgent : client).error().what);
    return exit_usage;
  }
  auto participant = dds::Participant::create(dds);
  if (!participant) {
    spdlog::error("{}", participant.error().what);
    return EXIT_FAILURE;
  }
  ground::Ground ground(std::move(flight), output, *participant, std::move(client).value(), std::move(urgent).value());
  if (auto status = ground.start(stop_requested); !status) {
    spdlog::error("{}", status.error().what);
    return EXIT_FAILURE;
  }
  const auto bridges = bridge::BesideBridges::create(config, bridged, *participant);
  if (!bridges) {
    spdlog::error("{}", bridges.error().what);
    return EXIT_FAILURE;
  }
  fmt::print("{{\"ready\":true}}\n");
  std::fflush(stdout);
  const auto ok = ground.run(stop_requested);
  if (!ok) {
    spdlog::error("{}", ok.error().what);
    return EXIT_FAILURE;
  }
  return *ok ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Flies drones around a path, or as a pilot's ROS 2 messages say (shape manual: /<drone>/takeoff, cmd_vel, "
      "land):\n"
      "reads their states from the ledger's blocks, and commands them through the ledger.\n"
      "Exit codes: 0 every drone finished its path and landed; 1 not so; 2 bad usage or config.\n"
      "SIGINT and SIGTERM land all drones.\n\n"
      "Example:\n  ledgerline-ground --config ground.toml\n\n"
      "ground.toml: [ledger] endpoint, tls_ca, msp_id, msp_dir, cross_check;\n"
      "          [[orderer]], [[peer]] endpoint, tls_ca; [[msp]] id, ca; [[drone]] name, number;\n"
      "  [flight] shape (square|triangle|x|eight|waypoints|manual), waypoints (CSV: x,y[,z[,speed]]), predict,\n"
      "          ramp_start_mps, ramp_step_mps, told_mps, told_mps2, pose_lost_ms, speed_mps, laps, seconds, height_m, "
      "side_m, lag_s, "
      "cmd_timeout_ms;\n"
      "  [output] trace, summary, status_period_ms; [dds] domain (ROS_DOMAIN_ID), local_only or cyclonedds, and for "
      "DDS Security\n"
      "    identity_ca, certificate, private_key, governance, permissions;\n"
      "  [[topic]], [[enrolled]], [bridge], [output] status: any ROS 2 topic, as `ledgerline bridge --help` has it",
      "ledgerline-ground"};
  std::string file;
  app.add_option("--config", file, "TOML file")->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? EXIT_SUCCESS : exit_usage;
  }
  init_log("ground");
  catch_stop_signals();
  auto config = Config::load(file);
  if (!config) {
    spdlog::error("{}", config.error().what);
    return exit_usage;
  }
  return fly(*config);
}
