#include "tools/init/core/host.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

#include "common/base/text.hpp"
#include "common/fabric/channels.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::init {
namespace {

using deployment::Deployment;
using deployment::Endpoint;
using deployment::Host;
using deployment::LedgerKind;
using deployment::Role;

std::string known_hosts(const Deployment& deployment) {
  std::string names;
  for (const Host& host : deployment.hosts) names += (names.empty() ? "" : ", ") + host.name;
  return names;
}

Result<std::string> endpoint_of(const Deployment& deployment, const Endpoint& place, const std::string& what) {
  if (place.port == 0)
    return Error{fmt::format("{} has no port: one that is chosen at the start is known to nobody", what)};
  return fmt::format("{}:{}", deployment.host(place.host)->address, place.port);
}

// The embedded ledger's certificate is made before it is known who asks: it speaks of localhost.
std::string server_name_of(const Deployment& deployment) {
  return deployment.ledger == LedgerKind::embedded ? "localhost" : "";
}

Status add_servers(const Deployment& deployment, HostPlan& plan) {
  bool found = false;
  for (const auto& organisation : deployment.organisations) {
    plan.msp_ids.push_back(organisation.id);
    auto at = endpoint_of(deployment, organisation.peer, organisation.id);
    if (!at) return at.error();
    const bool embedded = deployment.ledger == LedgerKind::embedded;
    const std::string tls = plan.folders.tls_of(embedded ? deployment.organisations[0].id : organisation.id);
    const Server server{organisation.id, *at, server_name_of(deployment), tls};
    if (organisation.id == plan.msp_id) {
      plan.own = server;
      found = true;
    }
    if (!embedded) plan.peers.push_back(server);
    plan.network_peers.push_back({deployment.host(organisation.peer.host)->address, organisation.peer.port});
  }
  for (const Endpoint& orderer : deployment.orderers) {
    auto at = endpoint_of(deployment, orderer, "an [[orderer]]");
    if (!at) return at.error();
    plan.orderers.push_back({"", *at, "", plan.folders.tls_of("orderers")});
    plan.network_orderers.push_back({deployment.host(orderer.host)->address, orderer.port});
  }
  // A host of the ledger alone has no programs that ask.
  if (!found && !plan.msp_id.empty()) return Error{fmt::format("there is no [[organisation]] {}", plan.msp_id)};
  return done;
}

HostDrone* find_drone(std::vector<HostDrone>& drones, const std::string& name) {
  const auto found = std::find_if(drones.begin(), drones.end(), [&](const HostDrone& one) { return one.name == name; });
  return found == drones.end() ? nullptr : &*found;
}

Status put_on_channel(HostPlan& plan, const std::string& name, const std::string& channel) {
  HostDrone* const drone = find_drone(plan.all_drones, name);
  if (!drone) return Error{fmt::format("--channel {}: there is no drone \"{}\"", channel, name)};
  if (!drone->channel.empty())
    return Error{
        fmt::format("--channel {}: {} is on {} already, and a drone is on one", channel, name, drone->channel)};
  drone->channel = channel;
  if (HostDrone* const own = find_drone(plan.drones, name)) own->channel = channel;
  return done;
}

}  // namespace

const Server& HostPlan::own_of(const std::string& of_channel) const {
  const auto found = own_on.find(of_channel);
  return found == own_on.end() ? own : found->second;
}

Status add_channels(HostPlan& plan, const std::vector<std::string>& texts) {
  if (texts.empty()) return done;
  if (plan.ledger != deployment::LedgerKind::fabric)
    return Error{"--channel: the embedded ledger has one channel; several are of Fabric (docs/fabric.md)"};
  for (const std::string& text : texts) {
    if (text == plan.channel) continue;
    const std::size_t at = text.find('=');
    const std::string channel = text.substr(0, at);
    if (!fabric::is_channel_name(channel) || at == std::string::npos || at + 1 == text.size())
      return Error{fmt::format("--channel is NAME=DRONE or NAME=DRONE,DRONE, not \"{}\"", text)};
    if (channel == plan.channel ||
        std::find(plan.more_channels.begin(), plan.more_channels.end(), channel) != plan.more_channels.end())
      return Error{fmt::format("--channel {}: there is a channel of that name already", channel)};
    if (const auto listed = plan.own_on.find(channel); listed != plan.own_on.end() && listed->second.endpoint.empty())
      return Error{fmt::format("--channel {}: the profile lists no peer of {} for it", channel, plan.msp_id)};
    plan.more_channels.push_back(channel);
    std::istringstream names(text.substr(at + 1));
    for (std::string name; std::getline(names, name, ',');)
      if (auto status = put_on_channel(plan, name, channel); !status) return status;
  }
  if (std::none_of(plan.all_drones.begin(), plan.all_drones.end(), [](const auto& one) { return one.channel.empty(); }))
    return Error{fmt::format("--channel: no drone is left on {}; each channel needs one", plan.channel)};
  return done;
}

Result<std::vector<HostDrone>> drones_of(const std::vector<std::string>& texts) {
  std::vector<HostDrone> drones;
  for (const std::string& text : texts) {
    const std::size_t at = text.find('=');
    HostDrone drone{text.substr(0, at), at == std::string::npos ? "" : text.substr(at + 1),
                    static_cast<int>(drones.size()) + 1};
    if (drone.name.empty()) return Error{"--drone is NAME or NAME=ADDRESS, not \"" + text + "\""};
    if (!contract::is_drone_name(drone.name))
      return Error{"--drone " + printable(drone.name) + ": a drone's name " + contract::drone_name_rule};
    drones.push_back(std::move(drone));
  }
  return drones;
}

Result<HostPlan> plan_of(const Deployment& deployment, const std::string& name, const Directories& folders) {
  const Host* host = deployment.host(name);
  if (!host) return Error{fmt::format("there is no [[host]] \"{}\": {}", name, known_hosts(deployment))};
  if (deployment.ledger == LedgerKind::none) return Error{"a deployment without a ledger has no configs of hosts"};
  HostPlan plan{.host = host->name, .msp_id = host->organisation, .ledger = deployment.ledger, .folders = folders};
  plan.channel = deployment.channel;
  plan.contract = deployment.contract;
  if (auto status = add_servers(deployment, plan); !status) return status.error();
  int number = 0;
  for (const deployment::Drone& drone : deployment.drones) {
    plan.all_drones.push_back({drone.name, drone.address, ++number});
    if (drone.host == name) plan.drones.push_back(plan.all_drones.back());
  }
  for (const auto& organisation : deployment.organisations) {
    if (plan.listen.empty() && organisation.peer.host == name)
      plan.listen = fmt::format("{}:{}", host->address, organisation.peer.port);
  }
  return plan;
}

}  // namespace ledgerline::init
