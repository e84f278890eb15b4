#include "tools/deployment/deployment.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <array>
#include <set>

#include "chaincode/identities/identities.hpp"
#include "common/msg/contract.hpp"
#include "common/msg/onboard.hpp"

namespace ledgerline::deployment {
namespace {

constexpr std::array roles{"drone-host", "ground", "ledger"};
static_assert(roles.size() == role_count && role_count == static_cast<std::size_t>(Role::ledger) + 1);

std::string unique_name(Config& config, const Key& key, std::set<std::string>& names) {
  std::string name = config.text(key);
  if (!name.empty() && !names.insert(name).second) config.wrong(key.name, "must be a name that no other has");
  return name;
}

std::string address(Config& config, const Key& key) {
  std::string text = config.text(key);
  in_addr ip{};
  if (!text.empty() && ::inet_pton(AF_INET, text.c_str(), &ip) != 1)
    config.wrong(key.name, fmt::format("is \"{}\", must be an IPv4 address, such as 10.0.0.1", text));
  return text;
}

std::vector<Role> read_roles(Config& config, const std::string& key) {
  std::vector<Role> out;
  for (const std::string& name :
       config.texts({key, "what runs there, at least one of drone-host, ground, ledger"}, role_count)) {
    const auto known = std::find(roles.begin(), roles.end(), name);
    if (known == roles.end()) {
      config.wrong(key, fmt::format("has \"{}\", must be of {}", name, fmt::join(roles, ", ")));
    } else {
      out.push_back(static_cast<Role>(known - roles.begin()));
    }
  }
  if (out.empty()) config.wrong(key, fmt::format("must name at least one of {}", fmt::join(roles, ", ")));
  return out;
}

// The name of a host that has the role.
std::string host_with(Config& config, const Key& key, Role role, const Deployment& deployment) {
  std::string name = config.text(key);
  const Host* host = deployment.host(name);
  if (name.empty()) return name;
  if (!host) {
    config.wrong(key.name, fmt::format("is \"{}\", must be the name of a [[host]]", name));
  } else if (!host->has(role)) {
    config.wrong(key.name, fmt::format("is \"{}\", whose roles have no \"{}\"", name, name_of(role)));
  }
  return name;
}

std::vector<Host> read_hosts(Config& config, std::size_t count) {
  std::vector<Host> hosts;
  std::set<std::string> names;
  for (std::size_t i = 0; i < count; ++i) {
    const std::string key = fmt::format("host.{}.", i);
    Host host;
    host.name = unique_name(config, {key + "name", "what the tables below call it"}, names);
    host.address = address(config, {key + "address", "IPv4, as the other hosts reach it"});
    host.roles = read_roles(config, key + "roles");
    host.organisation = config.text({key + "organisation", "[[organisation]] whose identity its programs have"}, "");
    hosts.push_back(std::move(host));
  }
  return hosts;
}

Endpoint read_endpoint(Config& config, const std::string& key, const Deployment& deployment) {
  const std::string host = host_with(config, {key + "host", "of role ledger"}, Role::ledger, deployment);
  return {host, static_cast<std::uint16_t>(
                    config.integer({key + "port", "its first; 0: free ones, where all is on one host"}, 0, 0, 65'535))};
}

void read_ledger(Config& config, Deployment& out) {
  const std::string kind = config.choice({"ledger.kind",
                                          "none: the controller beside the driver, for comparison; without [[host]] "
                                          "not that, but `existing`: a network that runs already"},
                                         {ledger_kinds.begin(), ledger_kinds.end()}, ledger_kinds[0]);
  out.ledger = ledger_kind_of(kind);
  out.channel = config.text({"ledger.channel", "of Fabric"}, out.channel);
  out.contract = config.text({"ledger.contract", "the chaincode's name on it"}, out.contract);
  std::set<std::string> ids;
  const std::size_t organisations = config.table_count(
      {"organisation", "of the ledger, and its peer's host; with the embedded one all are on one host"});
  for (std::size_t i = 0; i < organisations; ++i) {
    const std::string key = fmt::format("organisation.{}.", i);
    const std::string id = unique_name(config, {key + "id", "such as Org1MSP"}, ids);
    out.organisations.push_back({id, read_endpoint(config, key, out)});
  }
  const std::size_t orderers = config.table_count({"orderer", "of Fabric: one or three"});
  for (std::size_t i = 0; i < orderers; ++i)
    out.orderers.push_back(read_endpoint(config, fmt::format("orderer.{}.", i), out));
  for (std::size_t i = 0; i < out.hosts.size(); ++i) {
    const std::string& whose = out.hosts[i].organisation;
    if (!whose.empty() && !ids.contains(whose))
      config.wrong(fmt::format("host.{}.organisation", i),
                   fmt::format("is \"{}\", must be the id of an [[organisation]]", whose));
  }
}

void check_ledger(Config& config, const Deployment& deployment) {
  const bool has_ledger = deployment.ledger != LedgerKind::none;
  if (has_ledger == deployment.organisations.empty()) {
    config.wrong("organisation", has_ledger ? "must be there: a ledger has at least one [[organisation]]"
                                            : "must not be there with ledger.kind = \"none\"");
  }
  const std::size_t orderers = deployment.orderers.size();
  if (deployment.ledger == LedgerKind::fabric && orderers != 1 && orderers != 3)
    config.wrong("orderer", fmt::format("must be 1 or 3 tables, and there are {}", orderers));
  if (deployment.ledger != LedgerKind::fabric && orderers != 0)
    config.wrong("orderer", "goes with ledger.kind = \"fabric\" alone");
  for (std::size_t i = 1; deployment.ledger == LedgerKind::embedded && i < deployment.organisations.size(); ++i) {
    const Endpoint &first = deployment.organisations[0].peer, &other = deployment.organisations[i].peer;
    if (other.host != first.host || other.port != first.port)
      config.wrong(fmt::format("organisation.{}.host", i),
                   "must be the first one's: the embedded ledger is one process");
  }
}

void read_drones(Config& config, Deployment& out) {
  const std::size_t count = config.table_count({"drone", "1 to 16 of them"});
  if (count == 0 || count > max_drones) config.wrong("drone", fmt::format("must be 1 to {} tables", max_drones));
  std::set<std::string> names, addresses;
  for (std::size_t i = 0; i < std::min<std::size_t>(count, max_drones); ++i) {
    const std::string key = fmt::format("drone.{}.", i);
    Drone drone;
    drone.name = unique_name(config, {key + "name", "as enrolled on the ledger"}, names);
    if (!drone.name.empty() && !contract::is_drone_name(drone.name))
      config.wrong(key + "name", contract::drone_name_rule);
    drone.host = host_with(config, {key + "host", "of role drone-host: who flies it"}, Role::drone_host, out);
    drone.address = address(config, {key + "address", "IPv4, as its host reaches it"});
    if (!drone.address.empty() && !addresses.insert(drone.host + " " + drone.address).second)
      config.wrong(key + "address", "must be an address that no other drone of its host has");
    out.drones.push_back(std::move(drone));
  }
}

}  // namespace

LedgerKind ledger_kind_of(std::string_view name) {
  return static_cast<LedgerKind>(std::find(ledger_kinds.begin(), ledger_kinds.end(), name) - ledger_kinds.begin());
}
const char* name_of(Role role) { return roles[static_cast<std::size_t>(role)]; }

bool Host::has(Role role) const { return std::find(roles.begin(), roles.end(), role) != roles.end(); }

const Host* Deployment::host(const std::string& name) const {
  const auto found = std::find_if(hosts.begin(), hosts.end(), [&](const Host& host) { return host.name == name; });
  return found == hosts.end() ? nullptr : &*found;
}

Result<Deployment> read(Config& config) {
  Deployment out;
  const std::size_t hosts = config.table_count({"host", "a computer; at least one"});
  if (hosts == 0) config.wrong("host", "must be there: where programs run");
  out.hosts = read_hosts(config, hosts);
  read_ledger(config, out);
  check_ledger(config, out);
  read_drones(config, out);
  if (std::none_of(out.hosts.begin(), out.hosts.end(), [](const Host& host) { return host.has(Role::ground); }))
    config.wrong("host", "must have one with the role \"ground\"");
  if (auto status = config.finish(); !status) return status.error();
  return out;
}

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
