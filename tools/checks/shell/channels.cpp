#include "tools/checks/shell/probes.hpp"

#include <fmt/format.h>

#include "common/fabric/channels.hpp"
#include "common/fabric/config.hpp"

namespace ledgerline::checks {
namespace {

bool may_be_on_several(const ProgramConfig& one) { return one.program == "agent" || one.program == "ground"; }

void select_servers(const std::vector<fabric::Channels::For>& whose, const fabric::Channels::Table& channel,
                    std::vector<ServerKeys>& servers) {
  std::vector<ServerKeys> kept;
  for (std::size_t i = 0; i < servers.size() && i < whose.size(); ++i) {
    if (fabric::is_for(whose[i], channel)) kept.push_back(servers[i]);
  }
  servers = std::move(kept);
}

ProgramConfig on_channel(const ProgramConfig& one, const fabric::Channels& channels, std::size_t index) {
  const fabric::Channels::Table& table = channels.all[index];
  ProgramConfig own = one;
  own.file = fmt::format("{}, channel {}", one.file, table.name);
  own.label = fmt::format("channel {}: ", table.name);
  LedgerKeys& keys = *own.ledger;
  keys.channel = table.name;
  keys.contract = table.contract;
  if (index > 0) keys.config_block = table.config_block;
  if (!table.endpoint.empty()) {
    keys.peer.endpoint = table.endpoint;
    keys.peer.server_name = table.server_name;
    if (!table.tls_ca.empty()) keys.peer.tls_ca = table.tls_ca;
  }
  if (!table.tls_pair.certificate_file.empty()) {
    keys.peer.tls_certificate = table.tls_pair.certificate_file;
    keys.peer.tls_key = table.tls_pair.key_file;
  }
  select_servers(channels.orderers, table, keys.orderers);
  select_servers(channels.endorsers, table, keys.endorsers);
  select_servers(channels.peers, table, keys.peers);
  own.drones.clear();
  for (std::size_t i = 0; i < one.drones.size() && i < channels.of_drone.size(); ++i) {
    if (channels.of_drone[i] == index) own.drones.push_back(one.drones[i]);
  }
  return own;
}

}  // namespace

std::vector<ProgramConfig> of_each_channel(const ProgramConfig& one) {
  auto config = may_be_on_several(one) && one.ledger ? Config::load(one.path) : Result<Config>(Error{"of one"});
  if (!config) return {one};
  const fabric::Channels channels = fabric::read_channels(*config);
  if (!channels.several()) return {one};
  std::vector<ProgramConfig> all;
  for (std::size_t i = 0; i < channels.all.size(); ++i) all.push_back(on_channel(one, channels, i));
  return all;
}

Result<fabric::ClientConfig> client_of_channel(Config& config, const ProgramConfig& one) {
  auto ledger = fabric::ledger_config(config);
  if (!ledger || !may_be_on_several(one)) return ledger;
  const fabric::Channels channels = fabric::read_channels(config);
  auto all = fabric::each_channel(*ledger, channels);
  if (!all) return all.error();
  for (fabric::ClientConfig& each : *all) {
    if (each.where.channel == one.ledger->channel) return std::move(each);
  }
  return Error{fmt::format("{} has no channel {}", one.path, one.ledger->channel)};
}

fabric::ClientConfig client_at(const ServerKeys& peer, fabric::ClientConfig client) {
  client.endpoint = peer.endpoint;
  client.tls_ca_file = peer.tls_ca;
  client.server_name = peer.server_name;
  if (!peer.tls_certificate.empty()) client.tls_pair = {peer.tls_certificate, peer.tls_key};
  client.other_peers.clear();
  client.orderers.clear();
  client.endorsers.clear();
  client.blocks = fabric::BlockSource::peer;
  return client;
}

}  // namespace ledgerline::checks
