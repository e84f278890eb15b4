#include <cstdio>
#include <cstring>
#include <set>

#include "common/base/log.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/checks/shell/configs.hpp"
#include "tools/command/verbs.hpp"
#include "tools/status/shell/query.hpp"

namespace {

using namespace ledgerline;

constexpr const char* about =
    "Which programs of Ledgerline run on this host, since when and by which config; what the peers of those configs "
    "say of\n"
    "their channels; and how old the newest state of each drone is. Changes nothing.";
constexpr const char* notes = R"(
Examples:
  ledgerline status
  ledgerline status --config-dir ./raven --json

Asks by the configs of the programs that run, and by those in --config-dir: run it as a user who may read their keys, and as root
to see everybody's programs. What is wrong, and its cure, is for `ledgerline doctor` to say.
Exit codes: 0 each config's program runs and every peer answered; 1 one does not; 2 wrong usage.)";

}  // namespace

int ledgerline::command::status(int argc, char** argv) {
  CommandLine line("ledgerline status", about, notes);
  line.renamed("--patience", "--timeout");
  std::string dir = "/etc/ledgerline";
  bool json = false;
  double timeout_s = 3;
  line.option("--config-dir", dir, "where further configs are").shows_default();
  line.option("--timeout", timeout_s, "s, for each answer of a peer").within(0.1, 60.0).shows_default();
  line.flag("--json", json, "one object instead of tables");
  if (const auto end = line.parse(argc, argv)) return *end;
  spdlog::set_level(spdlog::level::off);  // what the parts log while they are asked is in the answers
  const auto timeout = std::chrono::milliseconds(static_cast<int>(1e3 * timeout_s));

  status::Status status{.programs = status::running_programs(), .not_running = {}, .ledgers = {}};
  std::vector<checks::ProgramConfig> configs;
  for (const status::Program& program : status.programs) {
    if (program.config.empty()) continue;
    if (auto read = checks::read_config(program.name.substr(std::strlen("ledgerline-")), program.config))
      configs.push_back(std::move(*read));
    else
      status.ledgers.push_back({.config = program.config, .channel = {}, .why = read.error().message});
  }
  checks::Configs further = checks::read_configs(dir, "");
  status.not_running = status::not_running(further, status.programs);
  for (checks::ProgramConfig& config : further.programs) configs.push_back(std::move(config));
  std::set<std::string> asked;
  for (const checks::ProgramConfig& config : configs) {
    if (!asked.insert(config.path).second) continue;
    for (const checks::ProgramConfig& each : checks::of_each_channel(config)) {
      if (each.ledger && !each.ledger->peer.endpoint.empty())
        status.ledgers.push_back(status::query_ledger(each, timeout));
    }
  }
  if (json)
    print_line(status::to_json(status));
  else
    std::fputs(status::words(status).c_str(), stdout);
  return status::all_well(status) ? 0 : exit_failed;
}
