#include "tools/init/core/host.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "tools/configuration/config_file.hpp"

namespace ledgerline::init {
namespace {

using configuration::ConfigFile;
using configuration::LedgerAccess;

constexpr const char* topics = "Topics";

// A program's keys, with those of the tables that it shares; but for topics, a subject of their own.
std::vector<KeyDescription> keys_of(const std::string& program) {
  const auto parts = configuration::parts();
  const auto part_named = [&](const std::string& name) {
    return std::find_if(parts.begin(), parts.end(), [&](const auto& part) { return part.name == name; });
  };
  const configuration::Part& own = *part_named(program);
  std::vector<KeyDescription> keys;
  for (const std::string& shared : own.shared) {
    if (shared == topics && program != "bridge") continue;
    const auto& more = part_named(shared)->keys;
    keys.insert(keys.end(), more.begin(), more.end());
  }
  keys.insert(keys.end(), own.keys.begin(), own.keys.end());
  return keys;
}

/// Those that the drones are on, in the plan's order. The first is that of [ledger], which must have a drone.
std::vector<std::string> channels_of(const HostPlan& plan, const std::vector<HostDrone>& drones) {
  const auto has_drone = [&](const std::string& name) {
    return std::any_of(drones.begin(), drones.end(), [&](const HostDrone& one) { return one.channel == name; });
  };
  std::vector<std::string> names;
  if (has_drone("")) names.push_back(plan.channel);
  for (const std::string& name : plan.more_channels)
    if (has_drone(name)) names.push_back(name);
  if (names.empty()) names.push_back(plan.channel);
  return names;
}

std::string block_of(const HostPlan& plan, const std::string& channel) {
  const Directories& folders = plan.folders;
  return channel == plan.channel && !folders.config_block.empty() ? folders.config_block
                                                                  : fmt::format("{}/{}.block", folders.config, channel);
}

/// Whose verdicts a receipt has: a peer of each organisation, of our own the one that serves the channel.
std::vector<Server> peers_of(const HostPlan& plan, const std::string& channel) {
  std::vector<Server> peers = plan.peers;
  for (Server& peer : peers)
    if (peer.msp_id == plan.msp_id) peer = plan.own_of(channel);
  return peers;
}

/// `follows`: the program reads blocks, so that it must know whom to trust.
LedgerAccess access_of(const HostPlan& plan, const std::string& channel, bool follows) {
  LedgerAccess access{.peer = plan.own_of(channel),
                      .tls_certificate = plan.folders.tls_certificate,
                      .tls_key = plan.folders.tls_key,
                      .channel = channel,
                      .contract = plan.contract,
                      .msp_id = plan.msp_id,
                      .msp_dir = plan.folders.msp(),
                      .config_block = block_of(plan, channel)};
  if (!follows) {
    access.endorsers = peers_of(plan, channel);
    return access;
  }
  access.timeouts = plan.timeouts;
  access.orderers = plan.orderers;
  if (!plan.orderers.empty()) access.endorsers = plan.peers;
  for (const std::string& id : plan.msp_ids) access.msps.emplace_back(id, plan.folders.authority_of(id));
  return access;
}

/// The first channel is that of [ledger], each other one has a table of its own.
void add_access(ConfigFile& values, const HostPlan& plan, const std::vector<std::string>& channels) {
  add_ledger(values, access_of(plan, channels[0], true));
  for (std::size_t i = 1; i < channels.size(); ++i) {
    values.text("[[channel]]", "name", channels[i], i - 1);
    values.text("[[channel]]", "config_block", block_of(plan, channels[i]), i - 1);
    if (const Server& other = plan.own_of(channels[i]); other.endpoint != plan.own_of(channels[0]).endpoint)
      add_server(values, "[[channel]]", other, i - 1);
  }
}

/// `ledger_channel`: of the file's [ledger]; null: the program knows none.
void add_drones(ConfigFile& values, const HostPlan& plan, const std::vector<HostDrone>& drones, bool with_address,
                const std::string* ledger_channel) {
  for (std::size_t i = 0; i < drones.size(); ++i) {
    values.text("[[drone]]", "name", drones[i].name, i);
    values.add("[[drone]]", "number", std::to_string(drones[i].number), i);
    if (with_address) values.text("[[drone]]", "address", drones[i].address, i);
    const std::string& channel = drones[i].channel.empty() ? plan.channel : drones[i].channel;
    if (ledger_channel && channel != *ledger_channel) values.text("[[drone]]", "channel", channel, i);
  }
}

std::string heading(const std::string& file, const HostPlan& plan) {
  return fmt::format(
      "{}{}{}. A key that begins with # has the default that stands there. docs/configuration.md is the reference.",
      file, plan.host.empty() ? "" : " of ", plan.host);
}

class Files {
 public:
  explicit Files(const HostPlan& plan) : plan_(plan) {}

  void link() {
    ConfigFile values;
    add_drones(values, plan_, plan_.drones, true, nullptr);
    // Real drones are not flown without a fence. Nobody said the room yet: a small one, in which no flight gets far.
    const bool real = std::any_of(plan_.drones.begin(), plan_.drones.end(),
                                  [](const HostDrone& one) { return !one.address.starts_with("127."); });
    if (real) {
      values.add("[fence]", "min_m", "[-3.0, -3.0, 0.0]");
      values.add("[fence]", "max_m", "[3.0, 3.0, 2.5]");
    }
    values.text("[output]", "starts", plan_.folders.state_of("ledgerline") + "/link.starts");
    values.text("[output]", "local_stops", plan_.folders.state_of("ledgerline") + "/link.stops");
    values.add("[playout]", "max_margin_ms", "0");
    write("link", "link.toml", values);
  }
  void agent() {
    ConfigFile values = with_drones("agent", plan_.drones, "ledgerline");
    add_timeouts(values, plan_.timeouts);
    write("agent", "agent.toml", values);
  }
  void ground() {
    ConfigFile values = with_drones("ground", plan_.all_drones, "ledgerline-ground");
    values.text("[flight]", "shape", "manual");  // a service that takes off as it starts is not what init may make
    values.text("[service]", "listen", "127.0.0.1:8800");
    values.text("[service]", "token_file", plan_.folders.state_of("ledgerline-ground") + "/page.token");
    write("ground", "ground.toml", values);
  }
  /// One for each channel: that of a further one is NAME-CHANNEL.toml.
  void control(const std::string& name) {
    for (const std::string& channel : channels_of(plan_, plan_.all_drones)) {
      ConfigFile values;
      add_ledger(values, access_of(plan_, channel, false));
      write("control", name + (channel == plan_.channel ? "" : "-" + channel) + ".toml", values);
    }
  }
  void bridge() {
    ConfigFile values;
    add_ledger(values, access_of(plan_, plan_.channel, true));
    add_output(values, "bridge", "ledgerline-bridge");
    write("bridge", "bridge.toml", values);
  }
  void network() {
    ConfigFile values;
    values.text("[[channel]]", "name", plan_.channel);
    for (std::size_t i = 0; i < plan_.more_channels.size(); ++i)
      values.text("[[channel]]", "name", plan_.more_channels[i], i + 1);
    const auto places = [&](const char* table, const std::vector<deployment::Endpoint>& all) {
      for (std::size_t i = 0; i < all.size(); ++i) {
        values.text(table, "host", all[i].host, i);
        values.add(table, "port", std::to_string(all[i].port), i);
      }
    };
    places("[[organisation]]", plan_.network_peers);
    places("[[orderer]]", plan_.network_orderers);
    write("fabric", "net.toml", values);
  }
  // For systemd's EnvironmentFile: these two have no config file.
  void node() {
    std::string options;
    for (const std::string& file : plan_.client_authorities) options += fmt::format(" --tls-client-ca {}", file);
    files_.push_back({"node.env", fmt::format("# Where ledgerline-node listens, for its unit, and further options.\n"
                                              "LEDGERLINE_LISTEN={}\nLEDGERLINE_NODE_OPTIONS={}\n",
                                              plan_.listen, options.empty() ? "" : options.substr(1))});
  }
  void chaincode() {
    files_.push_back(
        {"chaincode.env",
         fmt::format("# Of ledgerline-chaincode. The id is what the peer answered when the package was installed.\n"
                     "CHAINCODE_ID=\nCHAINCODE_SERVER_ADDRESS=0.0.0.0:9999\n"
                     "# TLS, without which it serves this host alone, and the authority of the peers that may call.\n"
                     "CHAINCODE_TLS_KEY={0}/tls/chaincode.key\nCHAINCODE_TLS_CERT={0}/tls/chaincode.pem\n"
                     "CHAINCODE_TLS_CLIENT_CA={1}\n",
                     plan_.folders.config, plan_.folders.tls_of(plan_.msp_id))});
  }
  Result<std::vector<File>> result() {
    if (!failed_) return failed_.error();
    return std::move(files_);
  }

 private:
  /// `service`: as its unit's StateDirectory has it.
  void add_output(ConfigFile& values, const std::string& program, const std::string& service) const {
    values.text("[output]", "checkpoint", fmt::format("{}/{}.checkpoint", plan_.folders.state_of(service), program));
    values.add("[dds]", "local_only", "true");
  }
  ConfigFile with_drones(const std::string& program, const std::vector<HostDrone>& drones,
                         const std::string& service) const {
    ConfigFile values;
    const auto channels = channels_of(plan_, drones);
    add_access(values, plan_, channels);
    add_drones(values, plan_, drones, false, &channels[0]);
    add_output(values, program, service);
    return values;
  }
  void write(const std::string& program, const std::string& file, const ConfigFile& values) {
    auto text = values.commented(heading(file, plan_), keys_of(program));
    if (text)
      files_.push_back({file, std::move(*text)});
    else
      failed_ = Error{fmt::format("{}: {}", program, text.error().message)};
  }

  const HostPlan& plan_;
  std::vector<File> files_;
  Status failed_ = done;
};

Status check_client_authorities(const HostPlan& plan) {
  if (plan.client_authorities.empty()) return done;
  if (plan.ledger == deployment::LedgerKind::fabric)
    return Error{"--tls-client-ca is of the embedded ledger; Fabric's peers have peer.tls.clientAuthRequired"};
  for (const std::string& file : plan.client_authorities)
    if (file.find_first_of(" \t$\"'\\") != std::string::npos)
      return Error{fmt::format("--tls-client-ca {}: the service takes no blanks, quotes and $ in a path", file)};
  return done;
}

}  // namespace

Role role_of(std::string_view name) {
  return static_cast<Role>(std::find(roles.begin(), roles.end(), name) - roles.begin());
}

Result<std::vector<File>> files_of(Role role, const HostPlan& plan) {
  if (role != Role::ledger && plan.msp_id.empty())
    return Error{fmt::format("host \"{}\" names no organisation whose identity its programs have", plan.host)};
  Files files(plan);
  switch (role) {
    case Role::drone_host:
      if (plan.drones.empty() && plan.host.empty()) return Error{"a drone host needs --drone NAME=ADDRESS"};
      if (plan.drones.empty()) return Error{fmt::format("no [[drone]] has host = \"{}\"", plan.host)};
      files.link();
      files.agent();
      break;
    case Role::ground:
      files.ground();
      files.control("operator");
      break;
    case Role::ledger:
      if (auto status = check_client_authorities(plan); !status) return status.error();
      if (plan.ledger == deployment::LedgerKind::fabric) {
        if (plan.network_orderers.empty()) return Error{"this network runs already: the ledger's role is its own"};
        files.network();
      } else {
        if (plan.listen.empty()) return Error{fmt::format("no [[organisation]] has host = \"{}\"", plan.host)};
        files.node();
      }
      break;
    case Role::chaincode:
      files.chaincode();
      break;
    case Role::bridge:
      files.bridge();
      break;
    case Role::admin:
      files.control("admin");
      break;
  }
  return files.result();
}

Result<std::string> example_deployment() {
  ConfigFile values;
  values.text("[ledger]", "kind", "embedded");
  struct Place {
    const char *name, *address, *roles, *organisation;
  };
  constexpr std::array<Place, 3> hosts{{{"raven", "10.0.0.4", "[\"drone-host\"]", "Org1MSP"},
                                        {"tower", "10.0.0.2", "[\"ledger\"]", ""},
                                        {"ground", "10.0.0.1", "[\"ground\"]", "Org2MSP"}}};
  for (std::size_t i = 0; i < hosts.size(); ++i) {
    values.text("[[host]]", "name", hosts[i].name, i);
    values.text("[[host]]", "address", hosts[i].address, i);
    values.add("[[host]]", "roles", hosts[i].roles, i);
    if (*hosts[i].organisation != 0) values.text("[[host]]", "organisation", hosts[i].organisation, i);
  }
  constexpr std::array organisations{"Org1MSP", "Org2MSP", "Org3MSP"};
  for (std::size_t i = 0; i < organisations.size(); ++i) {
    values.text("[[organisation]]", "id", organisations[i], i);
    values.text("[[organisation]]", "host", "tower", i);
    values.add("[[organisation]]", "port", "7051", i);
  }
  values.text("[[drone]]", "name", "tello1");
  values.text("[[drone]]", "host", "raven");
  values.text("[[drone]]", "address", "192.168.10.1");
  Config config = Config::describing();
  (void)deployment::read(config);
  return values.commented(
      "deployment.toml: which hosts there are and what runs on each, which drones, which ledger "
      "(docs/three-machines.md). The same file for all hosts.",
      config.described());
}

}  // namespace ledgerline::init
