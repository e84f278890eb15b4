#include "tools/status/shell/query.hpp"

#include "chaincode/endorser/core/endorser_core.hpp"
#include "common/config/config.hpp"
#include "common/fabric/client/client.hpp"
#include "common/fabric/config.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/names.hpp"
#include "common/msg/proto_json.hpp"
#include "common/msg/ros.hpp"
#include "common/verification/control_records.hpp"
#include "tools/checks/core/ledger.hpp"
#include "tools/checks/shell/probes.hpp"

namespace ledgerline::status {
namespace {

std::string text_of(const Identity& identity) {
  return identity.msp_id().empty() ? "" : identity.msp_id() + " " + identity.subject();
}

/// Each has a status, also without a pose. None: the ledger has none.
std::optional<DroneState> newest_state(const std::string& drone, const verification::Evaluate& evaluate) {
  QueryCall query;
  query.set_id(drone + "/link");
  const auto answer = evaluate({.function = contract::get, .args = {query.SerializeAsString()}});
  Assets assets;
  if (!answer || !parse_message(*answer, assets) || assets.assets_size() != 1) return std::nullopt;
  const auto state = state_from_cdr(assets.assets(0).msg_data(), "");
  return state ? std::optional(*state) : std::nullopt;
}

Drone query_drone(const std::string& name, const verification::Evaluate& evaluate) {
  Drone drone{.name = name};
  const auto control = verification::read_control(name, evaluate);
  if (!control) {
    drone.why = control.error().message;
    return drone;
  }
  drone.owner = text_of(control->owner());
  drone.holder = text_of(control->holder());
  drone.delegate = text_of(control->delegate());
  if (control->stoppers_size() > 0) drone.stopped_by = text_of(control->stoppers(0).stopper());
  if (const auto state = newest_state(name, evaluate)) {
    drone.phase = ledgerline::name(state->sample.phase);
    // Of a block of before there is no real time beside the state.
    if (state->real_ns != 0) drone.state_age_ns = realtime_ns() - state->real_ns;
  }
  return drone;
}

Peer height_of(const fabric::ClientConfig& config, const std::string& msp_id) {
  Peer peer{.endpoint = config.endpoint, .msp_id = msp_id};
  auto questions = fabric::PeerQueries::create(config);
  const auto height = questions ? (*questions)->height() : Result<std::uint64_t>(questions.error());
  peer.endorser = !height && height.error().message == endorser::for_its_contract_alone;
  if (height)
    peer.height = *height;
  else if (!peer.endorser)
    peer.why = height.error().message;
  return peer;
}

/// Whose the program's peer is: its own organisation's, unless an [[endorser]] at the same endpoint is another's.
std::string organisation_of_peer(const fabric::ClientConfig& client, const std::vector<checks::ServerKeys>& endorsers) {
  std::string msp_id = client.identity.name.msp_id;
  for (const checks::ServerKeys& one : endorsers) {
    if (one.endpoint != client.endpoint) continue;
    if (one.msp_id == client.identity.name.msp_id) return one.msp_id;
    msp_id = one.msp_id;
  }
  return msp_id;
}

}  // namespace

Ledger query_ledger(const checks::ProgramConfig& one, std::chrono::milliseconds timeout) {
  Ledger ledger{.config = one.path, .channel = one.ledger->channel};
  auto config = Config::load(one.path);
  auto client = config ? checks::client_of_channel(*config, one) : Result<fabric::ClientConfig>(config.error());
  if (client) client->deadline = timeout;
  auto questions =
      client ? fabric::PeerQueries::create(*client) : Result<std::unique_ptr<fabric::PeerQueries>>(client.error());
  if (!questions) {
    ledger.why = questions.error().message;
    return ledger;
  }
  ledger.peers.push_back(height_of(*client, organisation_of_peer(*client, one.ledger->endorsers)));
  for (const checks::ServerKeys& other : one.ledger->endorsers) {
    if (other.endpoint == client->endpoint) continue;
    ledger.peers.push_back(height_of(checks::client_at(other, *client), other.msp_id));
  }
  const auto height = ledger.peers.front().height;
  if (!height) return ledger;
  const auto block = (*questions)->block(*height - 1);
  if (block) ledger.newest_block_age_ns = checks::age_of_block(*block, realtime_ns());
  const verification::Evaluate evaluate = [&](const fabric::Call& call) {
    return (*questions)->query(client->where, call);
  };
  for (const checks::DroneKeys& drone : one.drones) ledger.drones.push_back(query_drone(drone.name, evaluate));
  return ledger;
}

}  // namespace ledgerline::status
