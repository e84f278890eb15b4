#include <fmt/format.h>

#include "chaincode/endorser/shell/service.hpp"
#include "common/base/log.hpp"
#include "common/bridge/shell/bridges.hpp"
#include "common/dds/dds.hpp"
#include "common/fabric/channels.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/program/program.hpp"
#include "common/verification/calls.hpp"
#include "ground/shell/ground.hpp"

namespace {

using namespace ledgerline;

/// Nothing has flown: ledgerline-ground.service starts it again, which it does not after exit_failed.
constexpr int exit_not_started = 3;

/// Topics, trace and page know a drone by its name, and shared memory by its number.
Status check_drones(const std::vector<ground::FlightDrone>& drones) {
  if (drones.empty()) return Error{"no [[drone]] to fly"};
  for (std::size_t i = 0; i < drones.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (drones[i].name == drones[k].name || drones[i].number == drones[k].number)
        return Error{fmt::format("[[drone]] {}: its name or number is there twice", drones[i].name)};
    }
  }
  return done;
}

/// A channel's part of the flight.
Result<ground::Channel::Parts> make_channel(Config& config, ground::FlightConfig flight,
                                            const fabric::ClientConfig& careful, const std::string& checkpoint) {
  auto trusted = fabric::msp_registry(config);
  if (!trusted) return trusted.error();
  flight.self = careful.identity.name;
  flight.trusted = std::move(trusted).value();
  flight.where = careful.where;
  auto kept = fabric::StoredCheckpoint::read(checkpoint, careful.where.channel);
  if (!kept) return kept.error();
  auto client = fabric::Client::create(careful);
  auto urgent = fabric::Client::create(careful);
  if (!client || !urgent) return fabric::of_channel(careful, (client ? urgent : client).error());
  return ground::Channel::Parts{std::move(flight), std::move(client).value(), std::move(urgent).value(),
                                std::move(*kept)};
}

int fly(Config& config) {
  const ground::FlightConfig flight = ground::flight_config(config);
  const ground::OutputSettings output = ground::output_settings(config);
  const ground::service::ServiceSettings service = ground::service_settings(config);
  ground::service::MissionSettings missions = ground::mission_settings(config);
  const std::string checkpoint = ground::checkpoint_path(config);
  bridge::BridgeConfig bridged = ground::read_bridge(config, flight.drones);
  bridged.checkpoint = bridge::checkpoint_beside(checkpoint);
  const dds::ParticipantOptions dds = dds::participant_options(config, "ledgerline_ground");
  const ground::PilotSettings pilot =
      ground::pilot_settings(config, !service.operators.empty(), dds.security.has_value());
  // What a leader that died took with it is given up soon: newer commands say more.
  auto ledger = fabric::ledger_config(config, std::chrono::seconds(1));
  auto trusted = fabric::msp_registry(config);
  const endorser::Settings within = endorser::read_own_endorser_settings(config);
  const fabric::Channels channels = fabric::read_channels(config);
  Status checked = config.finish();
  if (checked) checked = check_drones(flight.drones);
  if (checked && !ledger) checked = ledger.error();
  if (checked && !trusted) checked = trusted.error();
  if (checked) checked = endorser::check_channels(within, channels);
  if (!checked) return fail(checked.error(), exit_usage);
  // One along a path is not begun again: by then nobody watches the take-off.
  const int not_started = flight.manual ? exit_not_started : exit_failed;
  if (ledger->config_block.empty()) spdlog::warn("{}", fabric::blocks_not_validated);
  fabric::ClientConfig careful = verification::for_contract(std::move(ledger).value());
  auto certificates = fabric::watch_certificates(config, careful, channels.tls_pairs());
  if (!certificates) return fail(certificates.error(), exit_usage);
  auto ledgers = fabric::each_channel(careful, channels);
  if (!ledgers) return fail(ledgers.error(), exit_usage);
  std::vector<ground::Channel::Parts> parts;
  for (std::size_t i = 0; i < ledgers->size(); ++i) {
    fabric::ClientConfig& own = (*ledgers)[i];
    const auto longer_ns = fabric::apply_timeouts(own);
    if (!longer_ns) return fail(longer_ns.error(), not_started);
    if (const Status s = endorser::start_own_endorser(within, own); !s) return fail(s.error(), exit_usage);
    ground::FlightConfig of_channel = ground::flight_of_channel(flight, channels.of_drone, i);
    of_channel.limits.warn_silence_ns += *longer_ns;
    of_channel.limits.alarm_silence_ns += *longer_ns;
    auto made = make_channel(config, std::move(of_channel), own, fabric::file_of_channel(checkpoint, channels, i));
    if (!made) return fail(made.error(), exit_usage);
    parts.push_back(std::move(*made));
  }
  auto participant = dds::Participant::create(dds);
  if (!participant) return fail(participant.error(), not_started);
  ground::Ground ground(std::move(parts), channels.of_drone, output, pilot, *participant, std::move(*certificates));
  if (!service.listen.empty()) {
    if (auto status = ground.serve(service, std::move(missions), *ledgers); !status)
      return fail(status.error(), exit_usage);
  }
  if (auto status = ground.start(stop_requested); !status) return fail(status.error(), not_started);
  const auto bridges = bridge::BesideBridges::create(config, careful, bridged, *participant);
  if (!bridges) return fail(bridges.error(), not_started);
  print_line(ground.page_url().empty() ? R"({"ready":true})"
                                       : fmt::format(R"({{"ready":true,"page":"{}"}})", ground.page_url()));
  return exit_code(ground.run(stop_requested));
}

const char* const about =
    "Flies drones around a path, or as a pilot's ROS 2 messages say (shape manual: /<drone>/takeoff, cmd_vel, land):\n"
    "reads their states from the ledger's blocks, and commands them through the ledger. SIGINT and SIGTERM land all.";

const std::string notes =
    R"(Example:
  ledgerline-ground --config ground.toml

ground.toml: [[drone]] name, number, and for a path of its own shape, waypoints, side_m, speed_mps, laps;
)" + ledger_table_help +
    channel_tables_help +
    R"(  [flight] shape (square|triangle|x|eight|waypoints|manual), waypoints (CSV: x,y[,z[,speed]]), predict,
    ramp_start_mps, ramp_step_mps, full_scale_mps, max_acceleration_mps2, pose_lost_ms, speed_mps, laps, seconds,
    height_m, side_m, lag_s, cmd_timeout_ms, controller (a library of your own: docs/faults.md)
  [output] trace, summary, status_period_ms, checkpoint
  [own_endorser] msp_dir, check_one_in, checkpoint, first_state, first_state_hash, listen, tls_certificate, tls_key,
    summary (docs/fabric.md)
  [service] listen, token_file, tls_certificate, tls_key, tls_client_ca, names, operators, session_idle_s, faults
    (a page to fly from: docs/station.md)
  [pilot] topics, emergency (what pilots' ROS 2 topics may say: docs/ros2.md)
  [mission] folder, approvals, approvers, approval_hours, on_loss, after_restart, fence_min_m, fence_max_m
    (docs/station.md)
)" + dds_table_help +
    R"(Any ROS 2 topic beside the drones' own:
)" + topic_tables_help +
    R"(Exit codes: 0 every drone finished its path and landed (manual: landed, and nothing went wrong), while a stop
ends a flight along a path with 1; 1 not so; 2 bad usage or config; 3 manual: it could not begin, as without a ledger
for 15 s)";

}  // namespace

int main(int argc, char** argv) { return run_with_config(argc, argv, {"ledgerline-ground", about, notes}, fly); }
