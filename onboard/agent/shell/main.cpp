#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "chaincode/endorser/shell/service.hpp"
#include "common/base/log.hpp"
#include "common/bridge/shell/bridges.hpp"
#include "common/dds/dds.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/program/program.hpp"
#include "common/verification/calls.hpp"
#include "onboard/agent/shell/agent.hpp"

namespace {

using namespace ledgerline;

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

/// Our own organisation must be among those that are trusted: only its peers' endorsements count. Asks for the keys of
/// all [[msp]], so that finish() does not call those unknown that msp_registry did not reach.
Status check_own_msp(Config& config, const std::string& msp_id) {
  bool found = false;
  for (std::size_t i = 0; i < config.table_count("msp"); ++i) {
    (void)config.text(fmt::format("msp.{}.ca", i));
    found = config.text(fmt::format("msp.{}.id", i)) == msp_id || found;
  }
  if (found) return done;
  return Error{
      fmt::format("no [[msp]] has id = \"{}\": without our own organisation no command could be trusted", msp_id)};
}

/// Who is asked for a second opinion: the first peer named of another organisation; none: nobody is named.
Result<std::unique_ptr<fabric::Client>> make_witness(const fabric::ClientConfig& own) {
  const auto other = std::find_if(own.endorsers.begin(), own.endorsers.end(),
                                  [&](const auto& endorser) { return endorser.msp_id != own.identity.name.msp_id; });
  if (other == own.endorsers.end()) return std::unique_ptr<fabric::Client>();
  fabric::ClientConfig config;
  config.endpoint = other->endpoint;
  config.tls_ca_file = other->tls_ca_file;
  config.server_name = other->server_name;
  config.tls_pair = other->tls_pair.certificate_file.empty() ? own.tls_pair : other->tls_pair;
  config.where = own.where;
  config.identity = own.identity;
  config.tls_in_use = own.tls_in_use;
  config.deadline = own.deadline;
  return fabric::Client::create(std::move(config));
}

/// What `timeouts` of [ledger] adds for this channel.
Status wait_longer(fabric::ClientConfig& ledger, agent::Settings& settings) {
  const auto longer_ns = fabric::apply_timeouts(ledger);
  if (!longer_ns) return longer_ns.error();
  settings.core.check.max_age_ns += *longer_ns;
  settings.core.ledger_silent_after_ns += *longer_ns;
  return done;
}

/// One channel's part of the agent.
Result<std::unique_ptr<agent::AgentShell>> make_channel(Config& config, agent::Settings settings, bool several,
                                                        const fabric::ClientConfig& known,
                                                        const dds::ParticipantPtr& participant) {
  settings.blocks_are_validated = !known.config_block.empty();
  auto registry = fabric::msp_registry(config);
  if (!registry) return registry.error();
  auto kept = fabric::StoredCheckpoint::read(settings.checkpoint, known.where.channel);
  if (!kept) return kept.error();
  auto client = fabric::Client::create(known);
  auto urgent = fabric::Client::create(known);
  auto witness = make_witness(known);
  if (!client || !urgent) return fabric::of_channel(known, (client ? urgent : client).error());
  if (!witness) return fabric::of_channel(known, witness.error());
  return std::make_unique<agent::AgentShell>(agent::AgentShell::Parts{.settings = std::move(settings),
                                                                      .several = several,
                                                                      .registry = std::move(*registry),
                                                                      .client = std::move(*client),
                                                                      .urgent = std::move(*urgent),
                                                                      .witness = std::move(*witness),
                                                                      .participant = participant,
                                                                      .kept = std::move(*kept)});
}

int run(Config& config) {
  // What a leader that died took with it is given up soon: newer states say more.
  auto ledger = fabric::ledger_config(config, std::chrono::seconds(1));
  auto registry = fabric::msp_registry(config);
  const fabric::Channels channels = fabric::read_channels(config);
  const endorser::Settings within = endorser::read_own_endorser_settings(config);
  fabric::ClientConfig known = verification::for_contract(ledger ? *ledger : fabric::ClientConfig{});
  agent::Settings settings = agent::read_settings(config, known.identity.name.msp_id, known.where);
  bridge::BridgeConfig bridged = agent::read_bridge(config, settings.core.drones);
  bridged.checkpoint = bridge::checkpoint_beside(settings.checkpoint);
  const dds::ParticipantOptions dds = dds::participant_options(config, "ledgerline_agent");
  if (settings.core.seed == 0) settings.core.seed = static_cast<std::uint64_t>(realtime_ns());
  const Status own_msp = check_own_msp(config, known.identity.name.msp_id);
  Status checked = config.finish();
  if (checked) checked = check_drones(settings.core.drones);
  if (checked && !ledger) checked = ledger.error();
  if (checked && !registry) checked = registry.error();
  if (checked) checked = own_msp;
  if (checked) checked = endorser::check_channels(within, channels);
  if (!checked) return fail(checked.error(), exit_usage);
  if (known.config_block.empty()) spdlog::warn("{}", fabric::blocks_not_validated);
  auto certificates = fabric::watch_certificates(config, known, channels.tls_pairs());
  if (!certificates) return fail(certificates.error(), exit_usage);
  auto ledgers = fabric::each_channel(known, channels);
  if (!ledgers) return fail(ledgers.error(), exit_usage);
  dds::ParticipantPtr participant;
  if (!settings.mocap_topic.empty() || bridged.carries_something()) {
    auto made = dds::Participant::create(dds);
    if (!made) return fail(made.error());
    participant = std::move(made).value();
  }
  std::vector<agent::Settings> of_each = agent::settings_of_channels(settings, channels);
  std::vector<std::unique_ptr<agent::AgentShell>> shells;
  for (std::size_t i = 0; i < ledgers->size(); ++i) {
    if (auto status = wait_longer((*ledgers)[i], of_each[i]); !status) return fail(status.error());
    if (const Status s = endorser::start_own_endorser(within, (*ledgers)[i]); !s) return fail(s.error(), exit_usage);
    auto made = make_channel(config, std::move(of_each[i]), ledgers->size() > 1, (*ledgers)[i], participant);
    if (!made) return fail(made.error(), exit_usage);
    shells.push_back(std::move(*made));
  }
  agent::Agent all(std::move(settings), std::move(shells), stop_requested);
  all.watch_certificates(std::move(*certificates));
  if (auto status = all.start(); !status) return fail(status.error());
  const auto bridges = bridge::BesideBridges::create(config, known, bridged, participant);
  if (!bridges) return fail(bridges.error());
  print_line(R"({"ready":true,"program":"ledgerline-agent"})");
  return exit_code(all.run());
}

const char* const about =
    "Talks to the ledger for the drones of this host: states from link go out in batches, commands come back in\n"
    "blocks, are checked, and go to link as plans; mocap becomes pose and velocity.";

const std::string notes =
    R"(Example:
  ledgerline-agent --config agent.toml

agent.toml: [[drone]] name, number;
)" + ledger_table_help +
    channel_tables_help +
    R"(  [output] trace, summary, status_period_ms, checkpoint; and with defaults
  [mocap] topic, clock (host|arrival), position_sigma_m, acceleration_sigma_mps2, gate_sigma,
    outliers_before_reset, max_gap_ms, frozen_after_ms
  [check] max_age_ms, max_speed_mps, max_yaw_rate_radps, horizon_ms, stamps_kept
  [batch] min_gap_ms, linger_ms, freshness_ms, first_back_off_ms, max_back_off_ms, refused_drone_pause_ms
  [agent] heartbeat_ms, ledger_silent_after_ms, idle_evict_s, recheck_s, integrity_hold_s, max_absence_blocks, seed,
    start_wait_s
  [own_endorser] msp_dir, check_one_in, checkpoint, first_state, first_state_hash, listen, tls_certificate, tls_key, summary (docs/fabric.md)
  [realtime] priority (SCHED_FIFO from block to plan, below link's 80; 0: ordinary)
)" + dds_table_help +
    R"(Any ROS 2 topic beside the drones' own:
)" + topic_tables_help +
    R"(A status line (JSON) comes on standard output every status_period_ms. SIGINT and SIGTERM end it.
It ends by itself, too, when RouDi is gone and no drone of its link is in the air: start it behind a new RouDi.
Exit codes: 0 ended by a signal or for a new RouDi; 1 RouDi or ledger not reached, or a file not written; 2 bad
usage or config)";

}  // namespace

int main(int argc, char** argv) { return run_with_config(argc, argv, {"ledgerline-agent", about, notes}, run); }
