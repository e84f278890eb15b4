#include "hil/proxy/settings.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>

#include <charconv>
#include <limits>
#include <set>

#include "common/msg/onboard.hpp"

namespace ledgerline::hil::proxy {
namespace {

constexpr std::size_t max_servers = 64, max_faults = 10'000;
constexpr double max_script_s = 86'400;

std::optional<in_addr> parse_host(const std::string& text) {
  in_addr address{};
  if (::inet_pton(AF_INET, text.c_str(), &address) != 1) return std::nullopt;
  return address;
}

in_addr host(Config& config, const Key& key, const std::string& text) {
  const auto address = parse_host(text);
  if (!address && !text.empty()) config.wrong(key.name, "must be an IPv4 address, such as 127.0.1.2");
  return address.value_or(in_addr{});
}

sockaddr_in host_and_port(Config& config, const Key& key, unsigned min_port) {
  const std::string text = config.text(key);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  const std::size_t colon = std::min(text.rfind(':'), text.size());
  const auto ip = parse_host(text.substr(0, colon));
  const std::string port_text = text.substr(std::min(colon + 1, text.size()));
  unsigned port = 0;
  const auto [end, error] = std::from_chars(port_text.data(), port_text.data() + port_text.size(), port);
  const bool good = ip && error == std::errc() && end == port_text.data() + port_text.size() && port >= min_port &&
                    port <= std::numeric_limits<std::uint16_t>::max();
  if (!good && !text.empty()) config.wrong(key.name, "must be an IPv4 address and a port, such as 127.0.0.1:7051");
  if (good) {
    address.sin_addr = *ip;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
  }
  return address;
}

/// A name is a word of a command.
std::string name(Config& config, const std::string& key, std::set<std::string>& names) {
  const std::string name = config.text({key, "what commands call it: one word, unique"});
  if (name == "*" || name.find_first_of(" \t,") != std::string::npos)
    config.wrong(key, "must be one word without a comma, and not *");
  else if (!name.empty() && !names.insert(name).second)
    config.wrong(key, "must be a name that no other has");
  return name;
}

}  // namespace

std::vector<Target> Settings::targets() const {
  std::vector<Target> targets;
  for (const auto& drone : drones) targets.push_back({Target::Kind::drone, drone.name});
  for (const auto& server : servers) targets.push_back({Target::Kind::server, server.name});
  return targets;
}

Result<Settings> read_settings(const std::string& config_file, const std::string& script_file) {
  auto config = Config::load(config_file);
  if (!config) return config.error();
  auto settings = read_settings(*config);
  if (!settings || script_file.empty()) return settings;
  auto script = Config::load(script_file);
  if (!script) return script.error();
  settings->faults = read_faults(*script, settings->targets());
  if (settings->faults.empty()) script->wrong("fault", "must be there at least once");
  if (auto status = script->finish(); !status) return status.error();
  return settings;
}

std::vector<ScheduledFault> read_faults(Config& config, const std::vector<Target>& targets) {
  std::vector<ScheduledFault> faults;
  const std::size_t count = config.table_count("fault");
  if (count > max_faults) config.wrong("fault", fmt::format("must be {} tables at most", max_faults));
  bool all_possible = true;
  for (std::size_t i = 0; i < std::min(count, max_faults); ++i) {
    const std::string table = fmt::format("fault.{}.", i);
    ScheduledFault fault;
    fault.at_ns = from_seconds(config.number(table + "at_s", 0, max_script_s));
    const double for_s = config.number(table + "for_s", -1, 0, max_script_s);  // left out: -1
    if (for_s > 0) fault.for_ns = from_seconds(for_s);
    if (for_s == 0) config.wrong(table + "for_s", "must be more than 0; leave it out for a fault that stays");
    fault.command = config.text(table + "do");
    // One by one, so that the error names the line; what was switched before matters to none.
    const auto possible = CommandSchedule::make({fault}, Switches(targets));
    if (!fault.command.empty() && !possible) config.wrong(table + "do", possible.error().message);
    all_possible = all_possible && possible;
    faults.push_back(std::move(fault));
  }
  std::size_t which = 0;
  const auto together = CommandSchedule::make(faults, Switches(targets), &which);
  if (all_possible && !together) config.wrong(fmt::format("fault.{}.do", which), together.error().message);
  return faults;
}

Result<Settings> read_settings(Config& config) {
  Settings settings;
  settings.seed = static_cast<std::uint64_t>(
      config.integer({"proxy.seed", "of all chance: the same seed and traffic lose the same datagrams"}, 1, 0,
                     std::numeric_limits<std::int64_t>::max()));
  settings.faults_socket = config.text({"proxy.faults", "Unix socket for commands, mode 0600"}, "");
  settings.summary_file = config.text({"proxy.summary", "JSON file of all counts, written at the end"}, "");
  settings.source =
      host(config, "proxy.source",
           config.text(
               {"proxy.source",
                "own IPv4 toward drones, for state (8890) and video (11111); beside link on one host, one of its own"},
               "0.0.0.0"));
  std::set<std::string> drones, servers;
  const std::size_t drone_count = config.table_count({"drone", "UDP, a drone to stand before"}),
                    server_count = config.table_count({"server", "TCP, a server to stand before"});
  if (drone_count > max_drones) config.wrong("drone", fmt::format("must be {} tables at most", max_drones));
  if (server_count > max_servers) config.wrong("server", fmt::format("must be {} tables at most", max_servers));
  if (drone_count + server_count == 0) config.wrong("drone", "must be there, or [[server]]: what to stand before");
  for (std::size_t i = 0; i < std::min<std::size_t>(drone_count, max_drones); ++i) {
    const std::string table = fmt::format("drone.{}.", i);
    DroneRoute route;
    route.name = name(config, table + "name", drones);
    route.listen = host(config, table + "listen",
                        config.text({table + "listen", "IPv4 that clients fly, port 8889; one for each drone"}));
    route.address = host(config, table + "address", config.text({table + "address", "IPv4 of the drone"}));
    settings.drones.push_back(route);
  }
  for (std::size_t i = 0; i < std::min(server_count, max_servers); ++i) {
    const std::string table = fmt::format("server.{}.", i);
    ServerRoute route;
    route.name = name(config, table + "name", servers);
    route.listen = host_and_port(
        config, {table + "listen", "IPv4:PORT for clients; port 0: a free one, printed on standard output"}, 0);
    route.address = host_and_port(config, {table + "address", "IPv4:PORT of the server"}, 1);
    settings.servers.push_back(route);
  }
  if (auto status = config.finish(); !status) return status.error();
  return settings;
}

std::string address_text(const sockaddr_in& address) {
  char host[INET_ADDRSTRLEN] = {};
  ::inet_ntop(AF_INET, &address.sin_addr, host, sizeof host);
  return fmt::format("{}:{}", host, ntohs(address.sin_port));
}

}  // namespace ledgerline::hil::proxy
