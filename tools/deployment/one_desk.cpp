#include "tools/deployment/one_desk.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "chaincode/identities/identities.hpp"

namespace ledgerline::deployment {
namespace {

constexpr const char* loopback = "127.";

// Why the ledger is not one that the launcher makes; empty: it is.
std::string against_ledger(const Deployment& deployment) {
  if (deployment.ledger == LedgerKind::none) return "";
  const Deployment usual;
  if (deployment.channel != usual.channel || deployment.contract != usual.contract)
    return fmt::format("channel {} and contract {}: a flight on one desk has {} and {}", deployment.channel,
                       deployment.contract, usual.channel, usual.contract);
  const auto& organisations = deployment.organisations;
  bool known = organisations.size() == identities::organisations;
  for (std::size_t i = 0; known && i < organisations.size(); ++i)
    known = organisations[i].id == identities::msp_id_of(static_cast<int>(i) + 1);
  if (!known) return "a flight on one desk has the organisations Org1MSP, Org2MSP and Org3MSP, in this order";
  const auto has_port = [](const Endpoint& place) { return place.port != 0; };
  if (std::any_of(organisations.begin(), organisations.end(), [&](const auto& one) { return has_port(one.peer); }) ||
      std::any_of(deployment.orderers.begin(), deployment.orderers.end(), has_port))
    return "a flight on one desk looks for free ports: leave out `port`";
  return "";
}

// Why the drones are not the simulator's; empty: they are.
std::string against_drones(const Deployment& deployment) {
  for (std::size_t i = 0; i < deployment.drones.size(); ++i) {
    const Drone& drone = deployment.drones[i];
    const std::string name = fmt::format("tello{}", i + 1), address = fmt::format("127.0.0.{}", i + 2);
    if (drone.name != name || drone.address != address)
      return fmt::format("drone {} at {}: a flight on one desk is of simulated drones, and here stands {} at {}",
                         drone.name, drone.address, name, address);
  }
  return "";
}

}  // namespace

Result<OneDesk> on_one_desk(const Deployment& deployment) {
  std::string wrong;
  if (deployment.hosts.size() != 1)
    wrong = fmt::format("{} hosts: a flight on one desk has one", deployment.hosts.size());
  else if (!deployment.hosts.front().address.starts_with(loopback))
    wrong = fmt::format("host {} has address {}: a flight on one desk stays on 127.0.0.1",
                        deployment.hosts.front().name, deployment.hosts.front().address);
  if (wrong.empty()) wrong = against_ledger(deployment);
  if (wrong.empty()) wrong = against_drones(deployment);
  if (!wrong.empty()) return Error{fmt::format("{}: {}", deployment.file, wrong)};
  return OneDesk{static_cast<int>(deployment.drones.size()), deployment.ledger,
                 std::max(1, static_cast<int>(deployment.orderers.size()))};
}

}  // namespace ledgerline::deployment
