#include "common/bridge/core/rules.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "common/msg/contract.hpp"

namespace ledgerline::bridge {
namespace {

constexpr std::int64_t default_queue = 256, max_queued = 10'000;

constexpr std::array guarded_names{
    "*/cmd_vel",     "*/takeoff",   "*/land", "*/stop",    "*/emergency",  // pilots' (ground/core/topics.cpp)
    "/vrpn_mocap/*",                                                       // mocap's (agent, sim)
    "*/odom",        "*/pose",      "*/link", "*/battery", "*/imu",
    "*/failsafe",    "*/alarm",  // drones' (agent, ground)
    "/tf",           "/diagnostics"};

bool is_name_char(char c) { return contract::is_alphanumeric(c) || c == '_'; }

bool is_pattern(const std::string& name) {
  return name.size() > 1 && name.front() == '/' && name.back() != '/' && name.find("//") == std::string::npos &&
         std::ranges::all_of(name, [](char c) { return is_name_char(c) || c == '/' || c == '*'; });
}

bool is_segment(const std::string& name) {
  return !name.empty() && std::ranges::all_of(name, [](char c) { return is_name_char(c) || c == '-' || c == '.'; });
}

Rule read_rule(Config& config, const std::string& at) {
  Rule rule;
  rule.name = config.text(
      {at + "name", "* stands for any characters, / too. The first [[topic]] that matches, in a direction, decides"});
  if (!rule.name.empty() && !is_pattern(rule.name)) {
    config.wrong(at + "name", fmt::format("is \"{}\", must be a ROS 2 topic as in /a/b: a-z, A-Z, 0-9, _ and /, and * "
                                          "for any characters",
                                          rule.name));
  }
  rule.type = config.text({at + "type", "as std_msgs/msg/String: another type is not carried", "any"}, "");
  if (!rule.type.empty() && !is_ros_type(rule.type)) {
    config.wrong(at + "type", fmt::format("is \"{}\", must be as in std_msgs/msg/String", rule.type));
  }
  const std::string direction =
      config.choice({at + "direction", "of what it carries"}, {"to_ledger", "from_ledger", "both"}, "both");
  rule.to_ledger = direction != "from_ledger";
  rule.from_ledger = direction != "to_ledger";
  rule.from = config.text(
      {at + "from", "whose: first segment of the ids, an organisation's MSP id or an enrolled name; *: anybody's",
       "required for what comes from the ledger"},
      "");
  if (!rule.from.empty() && rule.from != anybody && !is_segment(rule.from)) {
    config.wrong(at + "from",
                 fmt::format("is \"{}\", must be an organisation's MSP id or an enrolled name, or \"*\" for anybody's",
                             rule.from));
  }
  if (rule.from.empty() && rule.from_ledger) {
    config.wrong(at + "from",
                 fmt::format("is missing: whose {} is taken from the ledger? Give an organisation's MSP id or an "
                             "enrolled name, \"*\" for anybody's, or direction = \"to_ledger\"",
                             rule.name));
  }
  rule.channel = config.text(
      {at + "channel", "of Fabric; each has its own transactions, blocks and pacing", "that of [ledger]"}, "");
  rule.config_block = config.text({at + "config_block",
                                   "trust anchor of its channel, as config_block of [ledger]: one topic of the channel "
                                   "names it; none: its blocks are taken unverified"},
                                  "");
  if (rule.channel.empty() && !rule.config_block.empty())
    config.wrong(at + "config_block", "is of a channel of its own; that of [ledger] has its own key there");
  rule.latest =
      config.choice({at + "keep", "latest: only the newest message waits"}, {"all", "latest"}, "all") == "latest";
  rule.latched = config.boolean(
      {at + "latched", "latecomers get the last value, from the ledger and on DDS (transient local)"}, false);
  rule.stream = config.boolean(
      {at + "stream", "rides in this host's one batch; for topics below a name in [[enrolled]]; not with latched"},
      false);
  rule.rate_hz = config.number({at + "rate_hz", "at most so many a second; 0: all"}, 0, 0, 10'000);
  rule.every = static_cast<int>(config.integer({at + "every", "every n-th message"}, 1, 1, 1'000'000));
  rule.priority = static_cast<int>(config.integer({at + "priority", "9 goes first, 0 last"}, 5, 0, 9));
  rule.queue = static_cast<std::size_t>(config.integer(
      {at + "queue", "messages that may wait (and 8 MB), then the oldest is dropped; 1 with keep = \"latest\""},
      default_queue, 1, max_queued));
  if (rule.latest) rule.queue = 1;
  rule.reliable = config.boolean({at + "reliable", "DDS's reliability; what a * finds has its writers'"}, true);
  rule.depth =
      static_cast<int>(config.integer({at + "depth", "of DDS's history", "queue, latched: 1"},
                                      rule.latched ? 1 : static_cast<std::int64_t>(rule.queue), 1, max_queued));
  if (rule.latched && rule.stream) {
    config.wrong(at + "stream", "must not be true with latched = true, whose value has a key of its own");
  }
  if (rule.latched && rule.from_ledger && (rule.from.empty() || rule.from == anybody)) {
    config.wrong(at + "latched",
                 "needs from = \"...\" (whose value: an organisation's MSP id or an enrolled name), or direction = "
                 "\"to_ledger\"");
  }
  return rule;
}

/// They come first, so that they decide.
std::vector<Rule> rules_of(const Host& host) {
  std::vector<Rule> rules;
  for (const std::string& topic : host.topics) {
    Rule& rule = rules.emplace_back();
    rule.name = topic;
    rule.to_ledger = rule.from_ledger = rule.left_out = true;
    rule.from = anybody;
  }
  return rules;
}

const Rule* unless_left_out(const std::vector<Rule>& rules, std::vector<Rule>::const_iterator rule) {
  return rule == rules.end() || rule->left_out ? nullptr : &*rule;
}

}  // namespace

bool BridgeConfig::carries_something() const {
  return std::ranges::any_of(rules, [](const Rule& rule) { return !rule.left_out; });
}

BridgeConfig read_bridge(Config& config, const Host* host) {
  BridgeConfig out;
  if (host) {
    out.beside = true;
    out.enrolled = host->enrolled;
    out.rules = rules_of(*host);
  }
  out.name = config.text({"bridge.name", "tells bridges of one identity apart"}, "");
  out.min_gap_ns =
      from_seconds(config.number({"bridge.min_gap_ms",
                                  "between two transactions of a kind: shorter makes more of them with fewer messages"},
                                 10, 0, 10'000) *
                   1e-3);
  out.bulk_share = config.number(
      {"bridge.bulk_share",
       "share of the time that messages above 8 kB are in flight while small ones of higher priority are"},
      out.bulk_share, 0.001, 1);
  out.status_file = config.text({"output.status", "file for `ledgerline topics`"}, "");
  out.status_period_ns =
      host ? ns_per_s
           : config.integer({"output.status_period_ms",
                             "between statuses, on standard output and in the file; within agent and ground 1,000"},
                            1'000, 10, 60'000) *
                 ns_per_ms;
  if (!host)
    out.checkpoint = config.text({"output.checkpoint",
                                  "file, of this bridge alone, of the newest verified block (another channel's is "
                                  "FILE.CHANNEL): the next start refuses a peer with an older chain or another one. "
                                  "Within agent and ground: their own file's name and .bridge"},
                                 "");
  for (std::size_t i = 0;
       i < config.table_count(
               {"enrolled",
                "a name enrolled to this identity: topics below /NAME/ have the id NAME/..., others MSPID/..."});
       ++i) {
    const std::string key = fmt::format("enrolled.{}.name", i);
    out.enrolled.push_back(config.text({key, "one segment of an id: [A-Za-z0-9_.-]"}));
    if (!is_segment(out.enrolled.back())) config.wrong(key, "must be one segment of an id: [A-Za-z0-9_.-]");
  }
  for (std::size_t i = 0; i < config.table_count({"topic", "a topic that is carried"}); ++i) {
    const std::string at = fmt::format("topic.{}.", i);
    out.rules.push_back(read_rule(config, at));
    const Rule& rule = out.rules.back();
    if (host && std::ranges::find(host->topics, rule.name) != host->topics.end())
      config.wrong(at + "name",
                   fmt::format("is \"{}\", which this program brings to or from the ledger itself", rule.name));
    if (host && host->sends_states && rule.stream) {
      config.wrong(at + "stream", "must not be true here: the one batch of this identity has the states of its drones");
    }
    const bool below_enrolled = std::ranges::any_of(
        out.enrolled, [&](const std::string& name) { return rule.name.starts_with("/" + name + "/"); });
    if (rule.stream && rule.to_ledger && !below_enrolled) {
      config.wrong(at + "stream",
                   "needs a topic below a name that is enrolled to this host and stands in [[enrolled]]");
    }
  }
  return out;
}

std::string checkpoint_beside(const std::string& own) { return own.empty() ? own : own + ".bridge"; }

std::string checkpoint_of(const BridgeConfig& config, const std::string& channel, const std::string& of_ledger) {
  return config.checkpoint.empty() || channel == of_ledger ? config.checkpoint : config.checkpoint + "." + channel;
}

bool is_wildcard(const Rule& rule) { return rule.name.find('*') != std::string::npos; }

const Rule* rule_up(const std::vector<Rule>& rules, std::string_view ros_topic) {
  return unless_left_out(rules, std::ranges::find_if(rules, [&](const Rule& rule) {
                           return rule.to_ledger && matches(rule.name, ros_topic);
                         }));
}

const Rule* rule_down(const std::vector<Rule>& rules, std::string_view ros_topic, std::string_view id, bool by_name) {
  return unless_left_out(rules, std::ranges::find_if(rules, [&](const Rule& rule) {
                           return rule.from_ledger && (rule.from == anybody || rule.from == first_segment(id)) &&
                                  !(by_name && is_wildcard(rule)) && matches(rule.name, ros_topic);
                         }));
}

bool is_guarded(std::string_view ros_topic) {
  return std::ranges::any_of(guarded_names, [&](const char* name) { return matches(name, ros_topic); });
}

bool matches(std::string_view pattern, std::string_view text) {
  // Where the last "*" began and what it has taken: longer each time that what follows does not fit.
  std::size_t p = 0, t = 0, star = std::string_view::npos, taken = 0;
  while (t < text.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      taken = t;
    } else if (p < pattern.size() && pattern[p] == text[t]) {
      ++p;
      ++t;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      t = ++taken;
    } else {
      return false;
    }
  }
  return pattern.substr(p).find_first_not_of('*') == std::string_view::npos;
}

bool is_ledger_id(std::string_view id) {
  return id.size() <= contract::max_id_chars && std::ranges::all_of(id, contract::is_id_char);
}

std::string_view first_segment(std::string_view id) { return id.substr(0, id.find('/')); }

bool is_msp_id(std::string_view segment) { return segment.ends_with("MSP"); }

std::string ledger_id(std::string_view ros_topic, std::string_view msp_id, const std::vector<std::string>& enrolled) {
  const std::string_view relative = ros_topic.substr(1);
  const auto known = std::ranges::find(enrolled, first_segment(relative));
  if (known != enrolled.end() && relative.size() > known->size()) return std::string(relative);
  return fmt::format("{}{}", msp_id, ros_topic);
}

std::string_view ros_topic_of(std::string_view id, std::string& buffer) {
  const std::string_view name = first_segment(id);
  if (is_msp_id(name)) return id.substr(name.size());
  buffer.assign(1, '/').append(id);
  return buffer;
}

bool is_ros_type(std::string_view type) {
  const std::size_t first = type.find('/'), last = type.rfind('/');
  if (first == std::string_view::npos || first == 0 || last + 1 == type.size()) return false;
  if (type.substr(first, last - first + 1) != "/msg/") return false;
  return std::ranges::all_of(type, [](char c) { return is_name_char(c) || c == '/'; });
}

std::uint64_t writer_of(const crypto::IdentityName& who, const std::string& bridge) {
  const crypto::Digest digest = crypto::sha256(who.msp_id + "\n" + who.subject + "\n" + bridge);
  std::uint64_t writer = 0;
  std::memcpy(&writer, digest.data(), sizeof writer);
  return writer;
}

}  // namespace ledgerline::bridge
