#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "common/base/log.hpp"
#include "common/dds/settings/config.hpp"
#include "common/program/stop_signals.hpp"
#include "tools/local/local.hpp"

namespace {

using namespace ledgerline;

constexpr int exit_usage = 2;

int fly(Config& config) {
  ground::FlightConfig flight = ground::flight_config(config);
  flight.ledger = false;
  const ground::OutputSettings output = ground::output_settings(config);
  const dds::ParticipantOptions dds = dds::participant_options(config, "ledgerline_local");
  Status checked = config.finish();
  if (checked && flight.drones.empty()) checked = Error{"no [[drone]] to fly"};
  if (checked && flight.manual) checked = Error{"flight.shape: a pilot speaks to ledgerline-ground, not to this"};
  if (!checked) {
    spdlog::error("{}", checked.error().what);
    return exit_usage;
  }
  auto participant = dds::Participant::create(dds);
  if (!participant) {
    spdlog::error("{}", participant.error().what);
    return EXIT_FAILURE;
  }
  hil::LocalShell local(std::move(flight), output, *participant, stop_requested);
  if (auto status = local.start(); !status) {
    spdlog::error("{}", status.error().what);
    return EXIT_FAILURE;
  }
  fmt::print("{{\"ready\":true}}\n");
  std::fflush(stdout);
  const auto ok = local.run();
  if (!ok) {
    spdlog::error("{}", ok.error().what);
    return EXIT_FAILURE;
  }
  return *ok ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Flies simulated drones around a path without a ledger: ground's controller beside link, as a reference for\n"
      "flights through one (fly --ledger none). Exit codes: 0 every drone finished its path and landed; 1 not so;\n"
      "2 bad usage or config. SIGINT and SIGTERM land all drones.\n\n"
      "Example:\n  ledgerline-local --config local.toml\n\n"
      "local.toml: [flight], [[drone]], [output] and [dds] as in `ledgerline ground --help`",
      "ledgerline-local"};
  std::string file;
  app.add_option("--config", file, "TOML file")->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? EXIT_SUCCESS : exit_usage;
  }
  init_log("local");
  catch_stop_signals();
  auto config = Config::load(file);
  if (!config) {
    spdlog::error("{}", config.error().what);
    return exit_usage;
  }
  return fly(*config);
}
