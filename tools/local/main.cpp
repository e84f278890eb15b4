#include "common/dds/dds.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"
#include "tools/local/local.hpp"

namespace {

using namespace ledgerline;

int fly_locally(Config& config) {
  ground::FlightConfig flight = ground::flight_config(config);
  flight.ledger = false;
  const ground::OutputSettings output = ground::output_settings(config);
  const dds::ParticipantOptions dds = dds::participant_options(config, "ledgerline_local");
  Status checked = config.finish();
  if (checked && flight.drones.empty()) checked = Error{"no [[drone]] to fly"};
  if (checked && flight.manual) checked = Error{"flight.shape: a pilot speaks to ledgerline-ground, not to this"};
  if (!checked) return fail(checked.error(), exit_usage);
  auto participant = dds::Participant::create(dds);
  if (!participant) return fail(participant.error());
  local::LocalShell local(std::move(flight), output, *participant, stop_requested);
  if (auto status = local.start(); !status) return fail(status.error());
  print_line(R"({"ready":true})");
  return exit_code(local.run());
}

const char* const about =
    "Flies simulated drones around a path without a ledger: ground's controller beside link, as a reference for\n"
    "flights through one (fly --ledger none). SIGINT and SIGTERM land all drones.";
const char* const notes = R"(Example:
  ledgerline local --config local.toml

local.toml: [flight], [[drone]], [output] and [dds] as in `ledgerline ground --help`
Exit codes: 0 every drone finished its path and landed; 1 not so; 2 bad usage or config)";

}  // namespace

int ledgerline::command::local(int argc, char** argv) {
  return run_with_config(argc, argv, {"ledgerline local", about, notes}, fly_locally);
}
