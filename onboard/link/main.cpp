#include <CLI/CLI.hpp>

#include "common/base/log.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "onboard/link/shell/link_shell.hpp"

int main(int argc, char** argv) {
  CLI::App app{"Flies Tello drones by the plans that agent hands over, and keeps them safe without it."};
  std::string config;
  app.add_option("--config", config,
                 "TOML file: [[drone]], [state], [limits], [fence], [failsafe], [realtime], [output]")
      ->required();
  app.footer(
      "Examples:\n"
      "  ledgerline-link --config link.toml\n"
      "A config for one simulated drone:\n"
      "  [[drone]]\n  name = \"tello1\"\n  address = \"127.0.0.2\"\n"
      "  [state]\n  listen = \"127.0.0.1:8890\"\n  rate_hz = 30.0\n"
      "SIGTERM lands what flies, and what may fly unseen (at most 10 s; 3 s for drones that nobody ever heard of), "
      "then\n"
      "ends. So it does when RouDi is gone, but not before all drones are on the ground: start it again behind a new\n"
      "RouDi.\n"
      "Exit codes: 0 all drones on the ground, or never heard of; 1 cannot serve, or a drone was not seen down; 2 bad\n"
      "usage or config");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  ledgerline::init_log("link");
  const auto settings = ledgerline::link::load_settings(config);
  if (!settings) {
    spdlog::error("{}", settings.error().what);
    return 2;
  }
  return ledgerline::link::run_link(*settings);
}
