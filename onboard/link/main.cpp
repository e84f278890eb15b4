#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "onboard/link/shell/link_shell.hpp"

namespace {

constexpr const char* about = "Flies Tello drones by the plans that agent hands over, and keeps them safe without it.";
constexpr const char* notes = R"(Examples:
  ledgerline-link --config link.toml
A config for one simulated drone:
  [[drone]]
  name = "tello1"
  address = "127.0.0.2"
  [state]
  listen = "127.0.0.1:8890"
  rate_hz = 30.0
SIGTERM, SIGINT, or SIGHUP of a terminal that is closed, lands what flies, and what may be airborne without state (at most 10 s; 3 s
for drones that nobody ever heard of), then ends. What it lands so stays down, for the next link, too ([output]
local_stops), until the drone's organisation clears it on the ledger, or SIGUSR1 comes.
It ends, too, when RouDi is gone, but not before all drones are on the ground: start it again behind a new RouDi.
Exit codes: 0 all drones on the ground, or never heard of; 1 cannot serve, or a drone was not seen down; 2 bad
usage or config)";

}  // namespace

int main(int argc, char** argv) {
  using namespace ledgerline;
  CommandLine line("ledgerline-link", about, notes);
  std::string config;
  line.option(config_argument, config,
              "TOML file: [[drone]], [state], [limits], [fence], [failsafe], [realtime], [output]")
      .required();
  if (const auto end = line.parse(argc, argv)) return *end;
  const auto settings = link::load_settings(config);
  return settings ? link::run_link(*settings) : fail(settings.error(), exit_usage);
}
