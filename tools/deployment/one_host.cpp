#include "tools/deployment/deployment.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "chaincode/identities/identities.hpp"

namespace ledgerline::deployment {
namespace {

constexpr const char* loopback = "127.";

void need_one_host(Config& config, const Deployment& deployment) {
  const std::string& address = deployment.hosts.front().address;
  if (!address.starts_with(loopback))
    config.wrong("host.0.address", fmt::format("is {}: a flight on one host stays on 127.0.0.1", address));
  for (std::size_t i = 1; i < deployment.hosts.size(); ++i)
    config.wrong(fmt::format("host.{}.name", i),
                 fmt::format("is \"{}\": a flight on one host has one host, and {} is another",
                             deployment.hosts[i].name, deployment.hosts[i].address));
}

void need_free_port(Config& config, const std::string& place, const Endpoint& endpoint) {
  if (endpoint.port != 0) config.wrong(place + ".port", "must not be there: a flight on one host looks for free ports");
}

void need_usual_ledger(Config& config, const Deployment& deployment) {
  if (deployment.ledger == LedgerKind::none) return;
  const Deployment usual;
  if (deployment.channel != usual.channel)
    config.wrong("ledger.channel",
                 fmt::format("is {}: a flight on one host has {}", deployment.channel, usual.channel));
  if (deployment.contract != usual.contract)
    config.wrong("ledger.contract",
                 fmt::format("is {}: a flight on one host has {}", deployment.contract, usual.contract));
  const auto& organisations = deployment.organisations;
  bool known = organisations.size() == identities::organisations;
  for (std::size_t i = 0; i < organisations.size(); ++i) {
    known = known && organisations[i].id == identities::msp_id_of(static_cast<int>(i) + 1);
    need_free_port(config, fmt::format("organisation.{}", i), organisations[i].peer);
  }
  if (!known)
    config.wrong("organisation", "must be Org1MSP, Org2MSP and Org3MSP, in this order, for a flight on one host");
  for (std::size_t i = 0; i < deployment.orderers.size(); ++i)
    need_free_port(config, fmt::format("orderer.{}", i), deployment.orderers[i]);
}

// The simulator's drones, or none that it could stand in for.
void need_simulated_drones(Config& config, const Deployment& deployment) {
  for (std::size_t i = 0; i < deployment.drones.size(); ++i) {
    const Drone& drone = deployment.drones[i];
    const std::string name = fmt::format("tello{}", i + 1), address = fmt::format("127.0.0.{}", i + 2);
    if (drone.name == name && drone.address == address) continue;
    config.wrong(fmt::format("drone.{}.{}", i, drone.name == name ? "address" : "name"),
                 fmt::format("{} at {}: a flight on one host is of simulated drones, and here stands {} at {}",
                             drone.name, drone.address, name, address));
  }
}

}  // namespace

Result<OneHost> on_one_host(Config& config, const Deployment& deployment) {
  need_one_host(config, deployment);
  need_usual_ledger(config, deployment);
  need_simulated_drones(config, deployment);
  if (auto status = config.finish(); !status) return status.error();
  return OneHost{static_cast<int>(deployment.drones.size()), deployment.ledger,
                 std::max(1, static_cast<int>(deployment.orderers.size()))};
}

Result<OneHost> read_one_host(Config& config) {
  const auto deployment = read(config);
  if (!deployment) return deployment.error();
  return on_one_host(config, *deployment);
}

}  // namespace ledgerline::deployment
