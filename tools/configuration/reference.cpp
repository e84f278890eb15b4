#include "tools/configuration/config_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <iterator>

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
  return status_of(deployment::read_own_drones(config, ""));
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
       "describes [drones that are there already](fly.md#real-drones): only there are `[pose]`, `[fence]`, `[rc]`, "
       "`[limits]`, `[flight]`, kind `existing` with `agent`, `ground`, `admin`, and a drone's keys from `interface` "
       "on (but no `host`).",
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

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() || word.empty() ? "" : ", ") + word;
  return text;
}

// The other choices than the default.
std::string other_choices(const KeyDescription& key) {
  std::vector<std::string> others;
  for (const std::string& choice : key.choices)
    if (choice != key.usual && '"' + choice + '"' != key.usual) others.push_back(choice);
  return joined(others);
}

// Type, default and range, as an engineer expects them: `100 ms, 20 to 60000`, `"mocap"; or tello, pads`,
// `text, required`.
std::string value_of(const KeyDescription& key) {
  const std::string usual = key.usual.empty() ? "required" : key.usual;
  const std::string unit = key.unit.empty() ? "" : " " + key.unit;
  const std::string whole = key.type == "whole number" ? "whole, " : "";
  if (!key.choices.empty()) return usual + "; or " + other_choices(key);
  const bool is_number = usual.find_first_not_of("-0123456789.e") == std::string::npos;
  if (key.type == "number" || !whole.empty())
    return joined({usual + (is_number ? unit : ""), whole + key.allowed + (is_number ? "" : unit)});
  if (key.type == "numbers") {
    if (key.usual.starts_with("[") && key.usual != "[]") return usual + unit;
    return joined({fmt::format("{} numbers{}", key.max.value_or(0), unit.empty() ? "" : " in" + unit),
                   key.usual == "[]" || key.usual == "none" ? "" : usual});
  }
  if (key.type == "texts") return joined({"list", key.usual == "[]" || key.usual == "none" ? "" : usual, key.allowed});
  if (key.type == "true or false" && (usual.starts_with("true") || usual.starts_with("false"))) return usual;
  if (key.usual.starts_with("\"")) return usual;
  return joined({key.type, key.usual == "none" ? "" : usual});
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

namespace {

std::vector<KeyDescription> keys_of(const Part& part, const std::string& table) {
  std::vector<KeyDescription> keys;
  std::copy_if(part.keys.begin(), part.keys.end(), std::back_inserter(keys),
               [&](const KeyDescription& key) { return key.table == table && !key.key.empty(); });
  return keys;
}

std::vector<std::string> tables_of(const Part& part) {
  std::vector<std::string> tables;
  for (const KeyDescription& key : part.keys)
    if (std::find(tables.begin(), tables.end(), key.table) == tables.end()) tables.push_back(key.table);
  return tables;
}

bool same_words(const KeyDescription& a, const KeyDescription& b) {
  return a.key == b.key && a.usual == b.usual && a.allowed == b.allowed && a.about == b.about;
}

bool same_keys(const std::vector<KeyDescription>& a, const std::vector<KeyDescription>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), same_words);
}

std::string link_to(const std::string& part) { return fmt::format("as in [{}]({})", part, anchor(part)); }

// The parts before this one, whose words it need not repeat. What several files share stands for itself.
std::vector<Part> before(const std::vector<Part>& all, const Part& part) {
  const auto shares = [&](const Part& other) {
    return std::find(other.shared.begin(), other.shared.end(), part.name) != other.shared.end();
  };
  if (std::any_of(all.begin(), all.end(), shares)) return {};
  const auto own = std::find_if(all.begin(), all.end(), [&](const Part& other) { return other.name == part.name; });
  return {all.begin(), own};
}

// "as in [link](#link)", where a part before this one has the same table; "keys as of [[orderer]]", where this part has
// them before; "": all of them are said here.
std::string same_table_before(const std::vector<Part>& earlier, const Part& part, const std::string& table) {
  const std::vector<KeyDescription> own = keys_of(part, table);
  for (const Part& other : earlier) {
    if (own.size() > 1 && same_keys(own, keys_of(other, table))) return link_to(other.name);
  }
  for (const std::string& before : tables_of(part)) {
    if (before == table) break;
    if (same_keys(own, keys_of(part, before))) return "keys as of " + before;
  }
  return "";
}

// Beyond so many letters a key is not said again, though the table of before has another name.
constexpr std::size_t long_words = 40;

// A row for each key; for keys that stand one after another, one: those that a part before this one has in the same
// words, and those with the same value and meaning.
std::string rows(const std::vector<Part>& earlier, const Part& part, const std::string& table) {
  struct Row {
    std::string keys, value, about;
  };
  std::vector<Row> rows;
  for (const KeyDescription& key : keys_of(part, table)) {
    Row next{fmt::format("`{}`", key.key), value_of(key), key.about};
    for (const Part& other : earlier) {
      const auto same = std::find_if(other.keys.begin(), other.keys.end(), [&](const KeyDescription& one) {
        return same_words(one, key) && (one.table == table || key.about.size() > long_words);
      });
      if (same == other.keys.end()) continue;
      next.value.clear();
      next.about = link_to(other.name) + (same->table == table ? "" : ", " + same->table);
      break;
    }
    if (!rows.empty() && rows.back().value == next.value && rows.back().about == next.about)
      rows.back().keys += ", " + next.keys;
    else
      rows.push_back(std::move(next));
  }
  std::string text;
  for (const Row& row : rows)
    text +=
        fmt::format("| {} |{}{} | {} |\n", row.keys, row.value.empty() ? "" : " ", cell(row.value), cell(row.about));
  return text;
}

}  // namespace

std::string show(const Part& part) {
  std::string text = fmt::format("## {}\n{}\n", part.name, part.words);
  for (const std::string& shared : part.shared) {
    text += fmt::format("{}[{}]({})", &shared == &part.shared.front() ? "With the tables of " : ", ", shared,
                        anchor(shared));
  }
  if (!part.shared.empty()) text += ".\n";
  if (part.keys.empty()) return text;
  text += "\n| key | value | what it does |\n| --- | --- | --- |\n";
  const std::vector<Part> earlier = before(parts(), part);
  for (const std::string& table : tables_of(part)) {
    const auto about = std::find_if(part.keys.begin(), part.keys.end(),
                                    [&](const auto& key) { return key.table == table && key.key.empty(); });
    const std::string same = same_table_before(earlier, part, table);
    std::string words = about == part.keys.end() ? "" : about->about;
    if (!same.empty()) words += (words.empty() ? "" : "; ") + same;
    if (!table.empty()) text += fmt::format("| **{}** | |{}{} |\n", table, words.empty() ? "" : " ", cell(words));
    if (same.empty()) text += rows(earlier, part, table);
  }
  return text;
}

std::string page() {
  std::string text =
      "# Every key of every program\n\n"
      "Made by `ledgerline configuration` out of the programs' config readers; a test compares. Change a reader, "
      "then\n`build/release/bin/ledgerline configuration > docs/configuration.md`.\n\n"
      "Files are TOML. A key that is unknown, of the wrong type or out of its range is an error that names file, line "
      "and key, and the program\ndoes not start. Relative paths count from where the program was started. `./fly` "
      "writes a file for each of its programs into its run's\nfolder.\n\n`value`: the default (in words where it "
      "depends on other things), then what is allowed. `required` has no "
      "default; a bare `text` or `list` (of texts)\nis none. Numbers may have fractions, but for `whole` ones.\n";
  for (const Part& part : parts()) text += "\n" + show(part);
  return text;
}

}  // namespace ledgerline::configuration
