#include <algorithm>
#include <csignal>
#include <cstdio>
#include <map>
#include <set>

#include "common/base/log.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/rt/clock.hpp"
#include "tools/checks/shell/configs.hpp"
#include "tools/checks/shell/host_probe.hpp"
#include "tools/checks/shell/probes.hpp"
#include "tools/command/verbs.hpp"
#include "tools/status/shell/query.hpp"

namespace {

using namespace ledgerline;
using namespace ledgerline::checks;

constexpr const char* about =
    "Looks at each link of the chain from this host, and says what is wrong and its cure. Changes nothing.";
constexpr const char* notes = R"(
Examples:
  ledgerline doctor
  ledgerline doctor --role drone-host --drones          # asks the drones, too; not while link runs
  ledgerline doctor --config-dir ./raven --json

Looks at whichever of link.toml, agent.toml, ground.toml, operator.toml, admin.toml, bridge.toml and
node.env are there, and at operator-CHANNEL.toml and admin-CHANNEL.toml of further channels. Run it as the user of the programs, who reads the keys. docs/troubleshooting.md has every word, its cause and its cure.
Exit codes: 0 all is well, but for warnings; 1 something is broken; 2 wrong usage.)";

struct Options {
  std::string dir = "/etc/ledgerline", role;
  bool json = false, drones = false, table = false;
  double timeout_s = 3;
};

std::vector<std::string> names_of(const std::vector<DroneKeys>& drones) {
  std::vector<std::string> names;
  for (const DroneKeys& drone : drones) names.push_back(drone.name);
  return names;
}

Findings room_of_ledger(const std::string& dir) {
  DirectoryInputs inputs = probe_directory(dir + "/ledger");
  inputs.writable = true;  // by its own user
  return inputs.free_bytes ? assess(inputs) : Findings{};
}

/// The embedded ledger of node.env: whether it answers, or else has room to start.
void check_node(const Configs& configs, const std::vector<status::Program>& running, std::chrono::milliseconds timeout,
                Findings& all) {
  if (!configs.node) return;
  const auto node = std::ranges::find(running, "ledgerline-node", &status::Program::name);
  if (node == running.end()) return add(all, room_of_ledger("/var/lib/ledgerline-node"));  // its unit's
  all.push_back(assess_presence(probe_server({.endpoint = configs.node->listen}, configs.node->path, timeout)));
}

void check_host(const Configs& configs, const std::vector<status::Program>& running, Findings& all) {
  std::set<std::string> folders, interfaces;
  for (const ProgramConfig& one : configs.programs) {
    for (const std::string& file : one.written) {
      const DirectoryInputs inputs = probe_directory(file);
      if (folders.insert(inputs.path).second) add(all, assess(inputs));
    }
    for (const std::string& name : one.interfaces)
      if (interfaces.insert(name).second) all.push_back(assess(probe_interface(name, one.file)));
  }
  for (const status::NotRunning& one : status::not_running(configs, running))
    all.push_back(assess_not_running(one.program, one.config));
  for (const status::Program& program : running) {
    if (!program.dir.empty() && folders.insert(program.dir).second) add(all, room_of_ledger(program.dir));
  }
  all.push_back(assess(probe_clock()));
  const ProgramConfig* const link = configs.of("link");
  if (!link && !configs.of("agent")) return;
  add(all, assess(probe_shared_memory()));
  if (!link) return;
  const auto runs = std::ranges::find(running, "ledgerline-link", &status::Program::name);
  add(all, assess(probe_real_time(link->real_time, runs == running.end() ? 0 : runs->pid)));
  if (!is_link_running()) all.push_back(assess(probe_port(link->state_listen)));
  if (const ProgramConfig* const agent = configs.of("agent"))
    all.push_back(assess_names(names_of(link->drones), names_of(agent->drones)));
  for (const DroneKeys& drone : link->drones)
    all.push_back(assess(probe_route(drone.name, drone.address, drone.interface)));
}

/// The own certificate of TLS, once. False: nobody can be reached with it.
bool check_tls_pair(const ServerKeys& keys, const ProgramConfig& one, std::map<std::string, bool>& seen,
                    Findings& all) {
  if (keys.tls_certificate.empty() && keys.tls_key.empty()) return true;
  const auto [place, first] = seen.try_emplace(keys.tls_certificate + " " + keys.tls_key, true);
  if (!first) return place->second;
  LedgerKeys pair;
  pair.msp_id = "TLS";  // what it is called in words
  pair.certificate = keys.tls_certificate;
  pair.private_key = keys.tls_key;
  Findings found = assess_tls_pair(read_identity(pair), one.file, realtime_ns() / ns_per_s);
  place->second = !anything_broken(found);
  add(all, std::move(found));
  return place->second;
}

/// What was looked at already.
struct Checked {
  std::set<std::string> servers;
  std::map<std::string, bool> identities, tls_pairs;  ///< whether each is in order
};

/// Each server once, but for each program its own peer. True: the program's own peer is in order.
bool check_servers(const ProgramConfig& one, std::chrono::milliseconds timeout, Checked& seen, Findings& all) {
  bool good = true;
  const auto look = [&](ServerKeys keys, const std::string& kind) {
    if (keys.tls_certificate.empty() && keys.tls_key.empty()) {
      keys.tls_certificate = one.ledger->peer.tls_certificate;
      keys.tls_key = one.ledger->peer.tls_key;
    }
    if (keys.endpoint.empty() || keys.tls_ca.empty()) {  // the program's own reader has said so
      if (kind == "peer") good = false;
      return;
    }
    const std::string same = keys.endpoint + " " + keys.server_name + " " + keys.tls_ca + " " + keys.tls_certificate;
    if (kind != "peer" && !seen.servers.insert(same).second) return;
    seen.servers.insert(same);
    if (!check_tls_pair(keys, one, seen.tls_pairs, all)) {
      if (kind == "peer") good = false;
      return;
    }
    const Finding finding = assess(probe_server(keys, fmt::format("{} of {}", kind, one.file), timeout));
    if (kind == "peer") good = !finding.problem;
    all.push_back(finding);
  };
  look(one.ledger->peer, "peer");
  for (const ServerKeys& keys : one.ledger->orderers) look(keys, "[[orderer]]");
  for (const ServerKeys& keys : one.ledger->endorsers) look(keys, "[[endorser]]");
  for (const ServerKeys& keys : one.ledger->peers) look(keys, "[[peer]]");
  return good;
}

void check_ledger(const Configs& configs, std::chrono::milliseconds timeout, Findings& all) {
  Checked seen;
  std::vector<ProgramConfig> programs;
  for (const ProgramConfig& one : configs.programs) {
    for (ProgramConfig& each : of_each_channel(one)) programs.push_back(std::move(each));
  }
  for (const ProgramConfig& one : programs) {
    if (!one.ledger || one.ledger->peer.endpoint.empty()) continue;
    Findings trust;
    const AnchorInputs anchor = read_anchor(*one.ledger, one.file, trust);
    if (!one.ledger->msps.empty()) add(trust, assess(read_trust(*one.ledger, one.file, anchor)));
    const IdentityInputs identity = read_identity(*one.ledger);
    Findings own;
    // By each channel's authorities; what is the same on all is reported once.
    const auto [good, is_new] =
        seen.identities.emplace(identity.msp_id + " " + identity.place + " " + identity.channel, true);
    if (is_new) {
      own = assess(identity, anchor.organisations, realtime_ns() / ns_per_s);
      good->second = !anything_broken(own);
    }
    const bool known = good->second && !anything_broken(trust);
    add(all, std::move(own));
    add(all, std::move(trust));
    const bool reached = check_servers(one, timeout, seen, all);
    const bool flies = one.program == "agent" || one.program == "ground";
    const std::vector<std::string> drones = names_of(one.drones);
    // What is broken before this would only be reported once more, in other words.
    if (!known || !reached || !flies) continue;
    Findings answers = query_ledger(one, anchor.block, anchor.embedded, drones, timeout);
    for (Finding& each : answers) each.what = one.label + each.what;
    add(all, std::move(answers));
  }
}

}  // namespace

int ledgerline::command::doctor(int argc, char** argv) {
  CommandLine line("ledgerline doctor", about, notes);
  line.renamed("--patience", "--timeout");
  Options options;
  line.option("--config-dir", options.dir, "where the configs are").shows_default();
  line.option("--role", options.role, "whose configs must be there; without: any")
      .one_of(std::vector<std::string>(std::begin(config_roles), std::end(config_roles)));
  line.flag("--drones", options.drones,
            "asks each drone for its battery, unless link runs, and listens for poses of motion capture");
  line.option("--timeout", options.timeout_s, "s, for each answer of the ledger").within(0.1, 60.0).shows_default();
  line.flag("--json", options.json, "one object instead of lines");
  line.flag("--table", options.table, "prints all problems with their cures, as Markdown, and looks at nothing");
  if (const auto end = line.parse(argc, argv)) return *end;
  if (options.table) {
    std::fputs(problems_table().c_str(), stdout);
    return 0;
  }
  std::signal(SIGPIPE, SIG_IGN);          // a server may close the connection while something is written to it
  spdlog::set_level(spdlog::level::off);  // what the parts log while they are asked is in the lines
  const auto timeout = std::chrono::milliseconds(static_cast<int>(1e3 * options.timeout_s));
  Configs configs = read_configs(options.dir, options.role);
  Findings all = std::move(configs.findings);
  const std::vector<status::Program> running = status::running_programs();
  check_host(configs, running, all);
  check_node(configs, running, timeout, all);
  check_ledger(configs, timeout, all);
  const ProgramConfig* const link = configs.of("link");
  if (options.drones && link) {
    add(all, query_drones(*link));
    if (const ProgramConfig* const agent = configs.of("agent")) add(all, receive_poses(*link, *agent));
  }
  all = without_repeats(std::move(all));
  if (options.json)
    print_line(to_json(all));
  else
    std::fputs(words(all).c_str(), stdout);
  return anything_broken(all) ? exit_failed : 0;
}
