#include "tools/configuration/config_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "chaincode/endorser/shell/settings.hpp"
#include "chaincode/network/options.hpp"
#include "common/bridge/core/rules.hpp"
#include "common/dds/dds.hpp"
#include "common/fabric/channels.hpp"
#include "common/fabric/config.hpp"
#include "ground/shell/settings.hpp"
#include "hil/proxy/settings.hpp"
#include "onboard/agent/shell/settings.hpp"
#include "onboard/link/shell/link_config.hpp"
#include "tools/deployment/deployment.hpp"
#include "tools/deployment/own_drones.hpp"

namespace ledgerline::configuration {
namespace {

constexpr const char* ledger = "The ledger";
constexpr const char* channels = "Several channels";
constexpr const char* topics = "Topics";
constexpr const char* dds = "DDS";

struct Source {
  const char* name;
  const char* words;
  std::vector<std::string> shared;
  /// What is wrong with keys is in finish(); the rest is what it returns.
  std::function<Status(Config&)> read;
};

template <typename T>
Status status_of(const Result<T>& read) {
  if (!read) return read.error();
  return done;
}

Status read_ledger(Config& config) {
  (void)fabric::ledger_config(config);
  (void)fabric::msp_registry(config);
  return done;
}
Status read_dds(Config& config) {
  (void)dds::participant_options(config, "");
  return done;
}
Status read_topics(Config& config) {
  const bridge::Host host;
  (void)bridge::read_bridge(config, &host);
  return done;
}

Status read_ground(Config& config) {
  const ground::FlightConfig flight = ground::flight_config(config);
  (void)ground::output_settings(config);
  (void)ground::service_settings(config);
  (void)ground::mission_settings(config);
  (void)ground::pilot_settings(config, false, false);
  (void)ground::checkpoint_path(config);
  (void)endorser::read_own_endorser_settings(config);
  (void)ground::read_bridge(config, flight.drones);
  return done;
}
// A file has hosts, or drones that are there already; the reference has both.
Status read_deployment(Config& config) {
  const bool of_own_drones = config.is_describing() || deployment::is_of_own_drones(config);
  if (config.is_describing() || !of_own_drones) {
    const auto read = deployment::read(config);
    if (!of_own_drones) return status_of(read);
  }
  return status_of(deployment::read_own_drones(config));
}

const std::vector<Source>& sources() {
  static const std::vector<Source> all{
      {"link",
       "`ledgerline-link --config link.toml`, on the drone's host. What the thresholds do is in [the "
       "failsafe](failsafe.md).",
       {},
       [](Config& config) { return status_of(link::read_settings(config, "link.toml")); }},
      {"agent",
       "`ledgerline-agent --config agent.toml`, on the drone's host.",
       {ledger, channels, topics, dds},
       [](Config& config) {
         (void)endorser::read_own_endorser_settings(config);
         (void)agent::read_bridge(config, agent::read_settings(config, "", {}).core.drones);
         return done;
       }},
      {"ground",
       "`ledgerline-ground --config ground.toml`, and `ledgerline local`, which reads `[flight]`, `[[drone]]`, "
       "`[output]` and `[dds]` alone.",
       {ledger, channels, topics, dds},
       read_ground},
      {"bridge",
       "`ledgerline bridge bridge.toml`: [any ROS 2 topic](ros2.md#any-topic-through-the-ledger) through the ledger.",
       {ledger, topics, dds},
       [](Config& config) {
         (void)bridge::read_bridge(config);
         return done;
       }},
      {"endorser",
       "`ledgerline endorser endorser.toml`: [an organisation's own "
       "endorser](fabric.md#an-organisations-own-endorser).",
       {ledger},
       [](Config& config) {
         (void)endorser::read_settings(config);
         return done;
       }},
      {"control",
       "`ledgerline control --config operator.toml`: leases, stops, grants and enrolments by hand. "
       "[Receipts](proof.md#receipts) are made with the same.",
       {ledger},
       {}},
      {"sim", "`ledgerline sim --config sim.toml`; all else are options.", {dds}, {}},
      {"proxy",
       "`ledgerline hil proxy --config proxy.toml`: [a bad network](faults.md#the-proxy).",
       {},
       [](Config& config) { return status_of(hil::proxy::read_settings(config)); }},
      {"fabric",
       "`ledgerline fabric ... --config net.toml`: [a network](fabric.md) of three organisations. Options on the "
       "command line come before the file.",
       {},
       [](Config& config) { return status_of(network::read_options(config, network::Options{})); }},
      {"deployment",
       "`deployment.toml`: [which hosts, drones, ledger](three-machines.md#what-is-where). A file without `[[host]]` "
       "has `[[drone]]`, `[ledger]`, `[pose]`, `[fence]`, `[rc]`, `[limits]` and `[flight]` alone, and [its drones are "
       "there "
       "already](fly.md#real-drones).",
       {},
       read_deployment},
      {ledger,
       "Where the ledger is, and whom to trust. At least one `[[msp]]` must be there; control alone, which reads no "
       "block, has none.",
       {},
       read_ledger},
      {channels,
       "Agent and ground may have their drones on [several channels](fabric.md#several-channels) of the ledger at "
       "once.",
       {ledger},
       [](Config& config) {
         (void)fabric::read_channels(config);
         return done;
       }},
      {topics,
       "[Any ROS 2 topic](ros2.md#any-topic-through-the-ledger) that the program carries: in bridge's own file, and in "
       "agent's and ground's beside their work.",
       {},
       read_topics},
      {dds, "How far DDS reaches, and its security: [DDS](ros2.md#dds).", {}, read_dds},
  };
  return all;
}

std::vector<KeyDescription> described(const std::function<Status(Config&)>& read) {
  Config config = Config::describing();
  if (read) (void)read(config);
  return config.described();
}

bool same_key(const KeyDescription& a, const KeyDescription& b) { return a.table == b.table && a.key == b.key; }

bool has(const std::vector<KeyDescription>& keys, const KeyDescription& key) {
  return std::any_of(keys.begin(), keys.end(), [&](const auto& other) { return same_key(other, key); });
}

// In a cell of a Markdown table.
std::string cell(std::string text) {
  for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2) text.insert(at, "\\");
  return text;
}

std::string row(const KeyDescription& key) {
  const std::string type = key.unit.empty() ? key.type : key.type + ", " + key.unit;
  return fmt::format("| `{}` | {} | {} | {} | {} |\n", key.key, type,
                     cell(key.usual.empty() ? "must be there" : key.usual), cell(key.allowed), cell(key.about));
}

std::string anchor(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return c == ' ' ? '-' : std::tolower(c); });
  return "#" + name;
}

}  // namespace

std::vector<Part> parts() {
  std::vector<Part> all;
  for (const Source& source : sources()) {
    std::vector<KeyDescription> elsewhere;
    for (const Source& other : sources()) {
      if (std::find(source.shared.begin(), source.shared.end(), other.name) == source.shared.end()) continue;
      const auto keys = described(other.read);
      elsewhere.insert(elsewhere.end(), keys.begin(), keys.end());
    }
    std::vector<KeyDescription> own = described(source.read);
    std::erase_if(own, [&](const auto& key) { return has(elsewhere, key); });
    all.push_back({source.name, source.words, source.shared, std::move(own)});
  }
  return all;
}

Status check(const std::string& part, Config& config) {
  const auto& all = sources();
  const auto named = [&](const std::string& name) {
    return std::find_if(all.begin(), all.end(), [&](const Source& source) { return name == source.name; });
  };
  const auto own = named(part);
  if (own == all.end()) return Error{fmt::format("there is no part \"{}\"", part)};
  for (const std::string& shared : own->shared) {
    if (shared != topics) (void)named(shared)->read(config);  // topics are read with what the program has itself
  }
  const Status rest = own->read ? own->read(config) : done;
  if (auto status = config.finish(); !status) return status;
  return rest;
}

std::string show(const Part& part) {
  std::string text = fmt::format("## {}\n{}\n", part.name, part.words);
  for (const std::string& shared : part.shared) {
    text += fmt::format("{}[{}]({})", &shared == &part.shared.front() ? "With the tables of " : ", ", shared,
                        anchor(shared));
  }
  if (!part.shared.empty()) text += ".\n";
  if (part.keys.empty()) return text;
  text += "\n| key | type | default | allowed | what it does, and why so |\n| --- | --- | --- | --- | --- |\n";
  std::vector<std::string> tables;
  for (const KeyDescription& key : part.keys) {
    if (std::find(tables.begin(), tables.end(), key.table) == tables.end()) tables.push_back(key.table);
  }
  for (const std::string& table : tables) {
    const auto in_table = [&](const KeyDescription& key) { return key.table == table; };
    const auto about = std::find_if(part.keys.begin(), part.keys.end(),
                                    [&](const auto& key) { return in_table(key) && key.key.empty(); });
    if (!table.empty())
      text += fmt::format("| **{}** | | | | {} |\n", table, about == part.keys.end() ? "" : cell(about->about));
    for (const KeyDescription& key : part.keys) {
      if (in_table(key) && !key.key.empty()) text += row(key);
    }
  }
  return text;
}

std::string page() {
  std::string text =
      "# Every key of every program\n\n"
      "Made by `ledgerline configuration` out of what the programs' readers ask for, so it cannot lag behind them; a "
      "test "
      "compares. Change a\nreader, then `build/release/bin/ledgerline configuration > docs/configuration.md`.\n\n"
      "Files are TOML. A key that is missing has its default; one that is unknown, of the wrong type or out of its "
      "range is an "
      "error that names file,\nline and key, and the program does not start. Relative paths count from where the "
      "program was "
      "started. `./fly` writes a file for each of\nits programs into its run's folder: an example of each. Scripts of "
      "faults "
      "are in [fault runs](faults.md) and [the proxy](faults.md#the-proxy), the\ntables of experiments in "
      "[experiments](measuring.md#experiments-ledgerline-experiment).\n";
  for (const Part& part : parts()) text += "\n" + show(part);
  return text;
}

}  // namespace ledgerline::configuration
