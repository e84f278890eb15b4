#include "tools/checks/shell/configs.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string_view>

#include "common/config/config.hpp"
#include "common/dds/reach.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "common/msg/ros.hpp"
#include "tools/configuration/config_file.hpp"
#include "tools/deployment/deployment.hpp"

namespace ledgerline::checks {
namespace {

/// The file is NAME.toml; of control's, which is on one channel, there are NAME-CHANNEL.toml of further ones.
struct ConfigKind {
  const char *program, *name, *role;
};
// net.toml is of a network that `ledgerline fabric` runs, and only there.
constexpr ConfigKind all_known[] = {{"link", "link", "drone-host"},  {"agent", "agent", "drone-host"},
                                    {"ground", "ground", "ground"},  {"control", "operator", ""},
                                    {"control", "admin", "admin"},   {"bridge", "bridge", "bridge"},
                                    {"endorser", "endorser", ""},    {"fabric", "net", ""},
                                    {"deployment", "deployment", ""}};

ServerKeys server_keys(Config& config, const std::string& table) {
  return {"",
          config.text(table + "endpoint", ""),
          config.text(table + "tls_ca", ""),
          config.text(table + "server_name", ""),
          config.text(table + "tls_certificate", ""),
          config.text(table + "tls_key", "")};
}

std::vector<ServerKeys> all_servers(Config& config, const std::string& table, bool endorsers) {
  std::vector<ServerKeys> all;
  for (std::size_t i = 0; i < config.table_count(table); ++i) {
    const std::string key = fmt::format("{}.{}.", table, i);
    all.push_back(server_keys(config, key));
    if (endorsers) all.back().msp_id = config.text(key + "msp_id", "");
  }
  return all;
}

LedgerKeys ledger_keys(Config& config, const std::string& program) {
  LedgerKeys keys;
  keys.peer = server_keys(config, "ledger.");
  const fabric::ChannelAndContract usual;
  keys.channel = config.text("ledger.channel", usual.channel);
  keys.contract = config.text("ledger.contract", usual.contract);
  keys.msp_id = config.text("ledger.msp_id", "");
  keys.msp_dir = config.text("ledger.msp_dir", "");
  keys.certificate = config.text("ledger.certificate", "");
  keys.private_key = config.text("ledger.private_key", "");
  keys.config_block = config.text("ledger.config_block", "");
  keys.patient = config.text("ledger.timeouts", "fixed") == "auto";
  const bool hurried = program == "agent" || program == "ground";
  keys.deadline_ns = config.integer("ledger.deadline_ms", hurried ? 1'000 : 5'000, 100, 600'000) * ns_per_ms;
  keys.orderers = all_servers(config, "orderer", false);
  keys.endorsers = all_servers(config, "endorser", true);
  keys.peers = all_servers(config, "peer", false);
  for (std::size_t i = 0; i < config.table_count("msp"); ++i)
    keys.msps.emplace_back(config.text(fmt::format("msp.{}.id", i), ""), config.text(fmt::format("msp.{}.ca", i), ""));
  return keys;
}

void read_drones(Config& config, ProgramConfig& out) {
  for (std::size_t i = 0; i < config.table_count("drone"); ++i) {
    const std::string key = fmt::format("drone.{}.", i);
    DroneKeys drone{config.text(key + "name", ""), "", ""};
    if (out.program == "link") {
      const std::string source = config.text(key + "pose_source", config.text("pose.source", "mocap"));
      drone.by_mocap = source == "mocap" || source == "mocap+tello";
      drone.address = config.text(key + "address", "");
      drone.interface = config.text(key + "interface", "");
      if (!drone.interface.empty()) out.interfaces.push_back(drone.interface);
    }
    out.drones.push_back(std::move(drone));
  }
}

void read_keys(Config& config, ProgramConfig& out) {
  const bool on_board = out.program == "link" || out.program == "agent";
  if (out.program != "link") out.ledger = ledger_keys(config, out.program);
  if (on_board || out.program == "ground") read_drones(config, out);
  for (const char* key :
       {"output.trace", "output.summary", "output.checkpoint", "output.starts", "output.local_stops"}) {
    std::string file = config.text(key, "");
    if (!file.empty()) out.written.push_back(std::move(file));
  }
  for (std::string& name : config.texts("dds.interfaces", dds::max_interfaces))
    out.interfaces.push_back(std::move(name));
  const deployment::Timeouts usual;
  if (out.program == "agent") {
    out.pose_topic = config.text("mocap.topic", usual_pose_topic);
    out.pose_type = config.text("mocap.type", name(PoseMessage::pose_stamped));
    out.max_age_ns = from_seconds(config.number("check.max_age_ms", to_ms(usual.max_age_ns), 1, 60'000) / 1e3);
    out.silent_after_ns =
        from_seconds(config.number("agent.ledger_silent_after_ms", to_ms(usual.silent_after_ns), 10, 60'000) / 1e3);
  }
  if (out.program == "link") {
    out.real_time = config.integer("realtime.priority", 80, 0, 98) > 0;
    out.state_listen = config.text("state.listen", "0.0.0.0:8890");
    out.battery_low = config.number("failsafe.battery_low", 0.15, 0.01, 0.95);
  }
}

/// Its file, NAME.toml, where it is there; and of control's, which is on one channel, those of further ones behind it.
std::vector<std::string> names_there(const std::string& dir, const ConfigKind& known) {
  std::vector<std::string> names;
  std::error_code error;
  const std::string usual = std::string(known.name) + ".toml", further = std::string(known.name) + "-";
  if (std::filesystem::exists(dir + "/" + usual, error)) names.push_back(usual);
  if (std::string_view(known.program) != "control") return names;
  std::filesystem::directory_iterator at(dir, error);
  const auto own = static_cast<std::ptrdiff_t>(names.size());
  for (const std::filesystem::directory_iterator end; !error && at != end; at.increment(error)) {
    const std::string name = at->path().filename();
    if (name.starts_with(further) && name.ends_with(".toml")) names.push_back(name);
  }
  std::sort(names.begin() + own, names.end());
  return names;
}

/// What the program itself would say at its start, a line each.
void read_as_program(const ProgramConfig& one, Findings& findings) {
  if (is_forbidden(one.path)) {
    findings.push_back(flag(Problem::file_forbidden, "config", one.path, cure_of_forbidden(one.path)));
    return;
  }
  auto config = Config::load(one.path);
  const Status read = config ? configuration::check(one.program, *config) : Status(config.error());
  if (read) {
    findings.push_back(fine("config", one.path));
    return;
  }
  std::istringstream lines(read.error().message);
  for (std::string line; std::getline(lines, line);) findings.push_back(flag(Problem::config_wrong, "config", line));
}

/// The embedded ledger has no TOML, but the environment of its unit, whose own address counts where this has none.
void read_node(const std::string& dir, const std::string& role, Configs& configs) {
  const std::string path = dir + "/node.env";
  std::error_code error;
  if (is_forbidden(path)) {
    configs.findings.push_back(flag(Problem::file_forbidden, "config", path, cure_of_forbidden(path)));
  } else if (std::filesystem::exists(path, error)) {
    configs.findings.push_back(fine("config", path));
    configs.node = {path, "127.0.0.1:7051"};
    constexpr std::string_view key = "LEDGERLINE_LISTEN=";
    std::ifstream lines(path);
    for (std::string line; std::getline(lines, line);)
      if (line.starts_with(key)) configs.node->listen = line.substr(key.size());
  } else if (role == "ledger" && !std::filesystem::exists(dir + "/net.toml", error)) {
    configs.findings.push_back(
        flag(Problem::config_missing, "config", path, "`ledgerline init --role ledger` writes it"));
  }
}

}  // namespace

bool is_forbidden(const std::string& path) {
  return ::faccessat(AT_FDCWD, path.c_str(), R_OK, AT_EACCESS) != 0 && errno == EACCES;
}

std::string cure_of_forbidden(const std::string& path) {
  return fmt::format("as root: `chmod a+r {}`, and `chmod a+x` its folders", path);
}

const ProgramConfig* Configs::of(const std::string& program) const {
  const auto one = std::find_if(programs.begin(), programs.end(), [&](const auto& p) { return p.program == program; });
  return one == programs.end() ? nullptr : &*one;
}

Result<ProgramConfig> read_config(const std::string& program, const std::string& path) {
  auto config = Config::load(path);
  if (!config) return config.error();
  ProgramConfig one{.program = program, .file = std::filesystem::path(path).filename(), .path = path};
  read_keys(*config, one);
  return one;
}

Configs read_configs(const std::string& dir, const std::string& role) {
  Configs configs;
  for (const ConfigKind& known : all_known) {
    const std::vector<std::string> names = names_there(dir, known);
    const std::string usual = std::string(known.name) + ".toml";
    if (!role.empty() && role == known.role && (names.empty() || names.front() != usual))
      configs.findings.push_back(flag(Problem::config_missing, "config", dir + "/" + usual,
                                      fmt::format("`ledgerline init --role {}` writes it", role)));
    for (const std::string& name : names) {
      ProgramConfig one{.program = known.program, .file = name, .path = dir + "/" + name};
      read_as_program(one, configs.findings);
      if (one.program == "fabric" || one.program == "deployment") continue;
      if (auto read = read_config(one.program, one.path)) configs.programs.push_back(std::move(*read));
    }
  }
  read_node(dir, role, configs);
  if (configs.findings.empty()) configs.findings.push_back(flag(Problem::config_missing, "config", dir + " has none"));
  return configs;
}

}  // namespace ledgerline::checks
