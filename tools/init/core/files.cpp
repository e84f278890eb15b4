#include "tools/init/core/files.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "tools/configuration/reference.hpp"
#include "tools/init/core/commented.hpp"

namespace ledgerline::init {
namespace {

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

class Values {
 public:
  void add(const char* table, const char* key, std::string value, std::size_t place = 0) {
    values_.push_back({table, place, key, std::move(value)});
  }
  void text(const char* table, const char* key, const std::string& value, std::size_t place = 0) {
    add(table, key, toml(value), place);
  }
  const std::vector<Value>& all() const { return values_; }

 private:
  std::vector<Value> values_;
};

// `reads` the reference: the keys that this version has.
void add_server(Values& values, const std::vector<KeyDescription>& reads, const char* table, std::size_t place,
                const Server& server) {
  values.text(table, "endpoint", server.endpoint, place);
  values.text(table, "tls_ca", server.tls_ca, place);
  const bool has_name = std::any_of(reads.begin(), reads.end(), [&](const KeyDescription& key) {
    return key.table == table && key.key == "server_name";
  });
  if (has_name && !server.server_name.empty()) values.text(table, "server_name", server.server_name, place);
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

void add_ledger(Values& values, const std::vector<KeyDescription>& reads, const HostPlan& plan,
                const std::vector<std::string>& channels, bool follows) {
  const Server& own = plan.own_of(channels[0]);
  add_server(values, reads, "[ledger]", 0, own);
  if (!plan.folders.tls_certificate.empty()) {
    values.text("[ledger]", "tls_certificate", plan.folders.tls_certificate);
    values.text("[ledger]", "tls_key", plan.folders.tls_key);
  }
  values.text("[ledger]", "channel", channels[0]);
  values.text("[ledger]", "contract", plan.contract);
  values.text("[ledger]", "msp_id", plan.msp_id);
  values.text("[ledger]", "msp_dir", plan.folders.msp());
  values.text("[ledger]", "config_block", block_of(plan, channels[0]));
  for (std::size_t i = 1; i < channels.size(); ++i) {
    values.text("[[channel]]", "name", channels[i], i - 1);
    values.text("[[channel]]", "config_block", block_of(plan, channels[i]), i - 1);
    if (const Server& other = plan.own_of(channels[i]); other.endpoint != own.endpoint)
      add_server(values, reads, "[[channel]]", i - 1, other);
  }
  if (!follows) return;
  if (plan.timeouts.deadline_ns != deployment::Timeouts{}.deadline_ns)
    values.add("[ledger]", "deadline_ms", fmt::format("{:.0f}", to_ms(plan.timeouts.deadline_ns)));
  for (std::size_t i = 0; i < plan.orderers.size(); ++i) add_server(values, reads, "[[orderer]]", i, plan.orderers[i]);
  for (std::size_t i = 0; !plan.orderers.empty() && i < plan.peers.size(); ++i) {
    values.text("[[endorser]]", "msp_id", plan.peers[i].msp_id, i);
    add_server(values, reads, "[[endorser]]", i, plan.peers[i]);
  }
  for (std::size_t i = 0; i < plan.msp_ids.size(); ++i) {
    values.text("[[msp]]", "id", plan.msp_ids[i], i);
    values.text("[[msp]]", "ca", plan.folders.authority_of(plan.msp_ids[i]), i);
  }
}

/// `ledger_channel`: of the file's [ledger]; null: the program knows none.
void add_drones(Values& values, const HostPlan& plan, const std::vector<HostDrone>& drones, bool with_address,
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
    Values values;
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
    write("link", "link.toml", keys_of("link"), values);
  }
  void agent() {
    const auto keys = keys_of("agent");
    Values values;
    const auto channels = channels_of(plan_, plan_.drones);
    add_ledger(values, keys, plan_, channels, true);
    add_drones(values, plan_, plan_.drones, false, &channels[0]);
    values.text("[output]", "checkpoint", plan_.folders.state_of("ledgerline") + "/agent.checkpoint");
    if (plan_.timeouts.max_age_ns != deployment::Timeouts{}.max_age_ns) {
      values.add("[check]", "max_age_ms", fmt::format("{:.0f}", to_ms(plan_.timeouts.max_age_ns)));
      values.add("[agent]", "ledger_silent_after_ms", fmt::format("{:.0f}", to_ms(plan_.timeouts.silent_after_ns)));
    }
    values.add("[dds]", "local_only", "true");
    write("agent", "agent.toml", keys, values);
  }
  void ground() {
    const auto keys = keys_of("ground");
    Values values;
    const auto channels = channels_of(plan_, plan_.all_drones);
    add_ledger(values, keys, plan_, channels, true);
    add_drones(values, plan_, plan_.all_drones, false, &channels[0]);
    values.text("[output]", "checkpoint", plan_.folders.state_of("ledgerline-ground") + "/ground.checkpoint");
    values.text("[flight]", "shape", "square");
    values.add("[dds]", "local_only", "true");
    write("ground", "ground.toml", keys, values);
  }
  /// One for each channel: that of a further one is NAME-CHANNEL.toml.
  void control(const std::string& name) {
    const auto keys = keys_of("control");
    for (const std::string& channel : channels_of(plan_, plan_.all_drones)) {
      Values values;
      add_ledger(values, keys, plan_, {channel}, false);
      write("control", name + (channel == plan_.channel ? "" : "-" + channel) + ".toml", keys, values);
    }
  }
  void bridge() {
    const auto keys = keys_of("bridge");
    Values values;
    add_ledger(values, keys, plan_, {plan_.channel}, true);
    values.text("[output]", "checkpoint", plan_.folders.state_of("ledgerline-bridge") + "/bridge.checkpoint");
    values.add("[dds]", "local_only", "true");
    write("bridge", "bridge.toml", keys, values);
  }
  void network() {
    Values values;
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
    write("fabric", "net.toml", keys_of("fabric"), values);
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
  Result<std::vector<File>> take() {
    if (!failed_.empty()) return Error{failed_};
    return std::move(files_);
  }

 private:
  void write(const std::string& program, const std::string& file, const std::vector<KeyDescription>& keys,
             const Values& values) {
    auto text = commented(heading(file, plan_), keys, values.all());
    if (text)
      files_.push_back({file, std::move(*text)});
    else
      failed_ = fmt::format("{}: {}", program, text.error().what);
  }

  const HostPlan& plan_;
  std::vector<File> files_;
  std::string failed_;
};

std::string fault_of_client_authorities(const HostPlan& plan) {
  if (plan.client_authorities.empty()) return "";
  if (plan.ledger == deployment::LedgerKind::fabric)
    return "--tls-client-ca is of the embedded ledger; Fabric's peers have peer.tls.clientAuthRequired";
  for (const std::string& file : plan.client_authorities)
    if (file.find_first_of(" \t$\"'\\") != std::string::npos)
      return fmt::format("--tls-client-ca {}: the service takes no blanks, quotes and $ in a path", file);
  return "";
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
      if (plan.drones.empty()) return Error{fmt::format("no [[drone]] has host = \"{}\"", plan.host)};
      files.link();
      files.agent();
      break;
    case Role::ground:
      files.ground();
      files.control("operator");
      break;
    case Role::ledger:
      if (auto fault = fault_of_client_authorities(plan); !fault.empty()) return Error{fault};
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
  return files.take();
}

Result<std::string> example_deployment() {
  Values values;
  values.text("[ledger]", "kind", "embedded");
  struct Place {
    const char *name, *address, *roles, *organisation;
  };
  constexpr std::array<Place, 3> hosts{{{"raven", "10.0.0.4", "[\"onboard\"]", "Org1MSP"},
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
  return commented(
      "deployment.toml: which hosts there are and what runs on each, which drones, which ledger "
      "(docs/deployment.md). The same file for all hosts.",
      config.described(), values.all());
}

}  // namespace ledgerline::init
