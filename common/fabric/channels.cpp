#include "common/fabric/channels.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/file.hpp"

namespace ledgerline::fabric {
namespace {

// As many as there may be drones in one agent: each channel needs one.
constexpr std::size_t max_channels = 16;

Channels::Table read_table(Config& config, const std::string& key, const ChannelAndContract& ledger) {
  Channels::Table table;
  table.name = config.text({key + "name", "of Fabric: a-z first, then a-z, 0-9, . and -"});
  table.contract = config.text({key + "contract", "the chaincode's name on it", "that of [ledger]"}, ledger.contract);
  table.config_block =
      config.text({key + "config_block", "as that of [ledger]; required where [ledger] has one", "none"}, "");
  table.endpoint = config.text({key + "endpoint",
                                "where another peer serves this channel; then only an [[orderer]], [[endorser]] or "
                                "[[peer]] that names the channel is used for it",
                                "that of [ledger]"},
                               "");
  table.tls_ca = config.text({key + "tls_ca", "as that of [ledger]", "that of [ledger]"}, "");
  table.server_name = config.text({key + "server_name", "as that of [ledger]", "that of [ledger]"}, "");
  table.tls_pair = {config.text({key + "tls_certificate", "as that of [ledger]", "that of [ledger]"}, ""),
                    config.text({key + "tls_key", "as that of [ledger]", "that of [ledger]"}, "")};
  return table;
}

void check_tables(Config& config, const Channels& channels, const std::string& block_of_ledger) {
  const std::vector<std::string> names = channels.names();
  if (names.size() > max_channels)
    config.wrong("channel", fmt::format("must be at most {}, with that of [ledger]", max_channels));
  for (std::size_t i = 1; i < names.size(); ++i) {
    const std::string key = fmt::format("channel.{}.", i - 1);
    const Channels::Table& table = channels.all[i];
    if (!is_channel_name(table.name)) {
      config.wrong(key + "name", "must be a channel's name: a-z first, then a-z, 0-9, . and -");
    } else if (static_cast<std::size_t>(std::ranges::find(names, names[i]) - names.begin()) < i) {
      config.wrong(key + "name", "must be another name than that of [ledger] and of each other [[channel]]");
    }
    // Silently trusting the peer on one channel of several is what nobody would see.
    if (table.config_block.empty() && !block_of_ledger.empty())
      config.wrong(key + "config_block", "must be there, since [ledger] has one: the trust anchor of this channel");
    if (table.endpoint.empty() && (!table.tls_ca.empty() || !table.server_name.empty()))
      config.wrong(key + "endpoint", "must be there with tls_ca or server_name");
    if (table.tls_pair.certificate_file.empty() != table.tls_pair.key_file.empty())
      config.wrong(key + "tls_key", "must be there with tls_certificate, and only with it");
  }
}

std::string list_of(const std::vector<std::string>& names) { return fmt::format("{}", fmt::join(names, " or ")); }

std::vector<Channels::For> read_servers(Config& config, const std::string& table,
                                        const std::vector<std::string>& names) {
  std::vector<Channels::For> all;
  for (std::size_t i = 0; i < config.table_count(table); ++i) {
    const std::string key = fmt::format("{}.{}.channels", table, i);
    all.push_back(config.texts({key, "that it is for; none: all at the endpoint of [ledger]"}, max_channels));
    for (const std::string& name : all.back()) {
      if (std::find(names.begin(), names.end(), name) == names.end())
        config.wrong(key, fmt::format("must be of this file's channels, {}", list_of(names)));
    }
  }
  return all;
}

void read_drones(Config& config, Channels& channels) {
  const std::vector<std::string> names = channels.names();
  std::vector<bool> used(names.size());
  const std::size_t count =
      config.is_describing() ? 1 : config.table_count("drone");  // the program describes its table
  for (std::size_t i = 0; i < count; ++i) {
    const std::string key = fmt::format("drone.{}.channel", i);
    const std::string name = config.text({key, "of its records", "that of [ledger]"}, names[0]);
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) config.wrong(key, fmt::format("must be one of this file's channels, {}", list_of(names)));
    channels.of_drone.push_back(found == names.end() ? 0 : static_cast<std::size_t>(found - names.begin()));
    used[channels.of_drone.back()] = true;
  }
  if (config.is_describing() || !channels.several()) return;
  if (!used[0])
    config.wrong("ledger.channel", fmt::format("must have a [[drone]]: none is on {}; a channel that has one may stand "
                                               "in [ledger] itself",
                                               names[0]));
  for (std::size_t i = 1; i < names.size(); ++i) {
    if (!used[i])
      config.wrong(fmt::format("channel.{}.name", i - 1),
                   fmt::format("must have a [[drone]] with channel = \"{}\"", names[i]));
  }
}

/// Of `servers` those that are for this channel.
template <typename Server>
std::vector<Server> chosen(const std::vector<Server>& servers, const std::vector<Channels::For>& whose,
                           const Channels::Table& channel) {
  std::vector<Server> out;
  for (std::size_t i = 0; i < servers.size(); ++i) {
    if (is_for(i < whose.size() ? whose[i] : Channels::For{}, channel)) out.push_back(servers[i]);
  }
  return out;
}

}  // namespace

bool is_for(const Channels::For& named, const Channels::Table& channel) {
  if (named.empty()) return channel.endpoint.empty();
  return std::find(named.begin(), named.end(), channel.name) != named.end();
}

std::vector<ClientConfig::TlsPair> Channels::tls_pairs() const {
  std::vector<ClientConfig::TlsPair> pairs;
  for (const Table& one : all) pairs.push_back(one.tls_pair);
  return pairs;
}

std::vector<std::string> Channels::names() const {
  std::vector<std::string> out;
  for (const Table& table : all) out.push_back(table.name);
  return out;
}

Channels read_channels(Config& config) {
  const ChannelAndContract usual;
  const ChannelAndContract ledger{config.text("ledger.channel", usual.channel),
                                  config.text("ledger.contract", usual.contract)};
  Channels channels;
  channels.all.push_back({.name = ledger.channel, .contract = ledger.contract});
  const std::size_t count =
      config.table_count({"channel", "each further channel that drones are on; that of [ledger] has no table"});
  for (std::size_t i = 0; i < count; ++i)
    channels.all.push_back(read_table(config, fmt::format("channel.{}.", i), ledger));
  if (!config.is_describing()) check_tables(config, channels, config.text("ledger.config_block", ""));
  const std::vector<std::string> names = channels.names();
  channels.orderers = read_servers(config, "orderer", names);
  channels.endorsers = read_servers(config, "endorser", names);
  channels.peers = read_servers(config, "peer", names);
  read_drones(config, channels);
  return channels;
}

Result<std::vector<ClientConfig>> each_channel(const ClientConfig& ledger, const Channels& channels) {
  std::vector<ClientConfig> out;
  for (const Channels::Table& table : channels.all) {
    ClientConfig one = ledger;
    one.where = {table.name, table.contract};
    one.orderers = chosen(ledger.orderers, channels.orderers, table);
    one.endorsers = chosen(ledger.endorsers, channels.endorsers, table);
    one.other_peers = chosen(ledger.other_peers, channels.peers, table);
    if (!table.endpoint.empty()) {
      one.endpoint = table.endpoint;
      one.server_name = table.server_name;
      if (!table.tls_ca.empty()) one.tls_ca_file = table.tls_ca;
    }
    if (!table.tls_pair.certificate_file.empty()) one.tls_pair = table.tls_pair;
    if (!out.empty()) one.config_block.clear();
    if (!table.config_block.empty()) {
      auto block = read_file(table.config_block);
      if (!block) return Error{fmt::format("config_block of channel {}: {}", table.name, block.error().message)};
      one.config_block = std::move(*block);
    }
    out.push_back(std::move(one));
  }
  return out;
}

std::string file_of_channel(const std::string& path, const Channels& channels, std::size_t channel) {
  return path.empty() || channel == 0 ? path : path + "-" + channels.all[channel].name;
}

Error of_channel(const ClientConfig& config, const Error& why) {
  return Error{fmt::format("channel {}: {}", config.where.channel, why.message)};
}

bool is_channel_name(const std::string& name) {
  return !name.empty() && name.size() < 250 && name[0] >= 'a' && name[0] <= 'z' &&
         name.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789.-") == std::string::npos;
}

}  // namespace ledgerline::fabric
