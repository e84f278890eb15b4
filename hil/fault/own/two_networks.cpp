#include "hil/fault/own/two_networks.hpp"

#include <fmt/format.h>

#include <csignal>
#include <filesystem>
#include <utility>

#include "hil/fault/own/own_code.hpp"

namespace ledgerline::hil {
namespace {

constexpr TimeNs network_timeout_ns = 10 * ns_per_s, network_look_ns = 5 * ns_per_ms;
constexpr const char* sky_end = "10.77.2.1";  // the cable's ends
constexpr const char* client_end = "10.77.1.1";
constexpr const char* clients_network = "192.168.10.0/24";  // of the proxy's fronts: there is no way around it
constexpr const char* advice =
    "an SDK client gets a network of its own, which takes root, if only of a user namespace: run this as root, or "
    "below "
    "`unshare -Urn`";

std::string network_of(const std::string& file) {
  std::error_code error;
  return std::filesystem::read_symlink(file, error).string();
}

}  // namespace

std::string TwoNetworks::file_of(const std::string& name) const {
  return fmt::format("/proc/{}/ns/net", children_.pid(name));
}

std::vector<std::string> TwoNetworks::enter(const std::string& name) const {
  return {nsenter_, "--net=" + file_of(name)};
}

Status TwoNetworks::find_tools() {
  for (const auto& [name, at] :
       {std::pair("unshare", &unshare_), {"nsenter", &nsenter_}, {"sleep", &sleep_}, {"sh", &sh_}}) {
    auto found = program_at(name);
    if (!found) return found.error();
    *at = std::move(*found);
  }
  const auto ip = program_at("ip");  // the shell finds it by itself
  return ip ? Status(done) : ip.error();
}

Status TwoNetworks::hold(const std::string& name, const std::string& directory) {
  if (auto started = children_.start(
          {name, {unshare_, "-n", sleep_, "infinity"}, fmt::format("{}/{}.log", directory, name), SIGKILL});
      !started)
    return started;
  const std::string mine = network_of("/proc/self/ns/net");
  for (const TimeNs until = monotonic_ns() + network_timeout_ns; monotonic_ns() < until;) {
    if (!children_.running(name)) return Error{fmt::format("{}: {}", advice, children_.log_tail(name, 2))};
    const std::string its = network_of(file_of(name));
    if (!its.empty() && its != mine) return done;
    children_.poll(network_look_ns);
  }
  return Error{advice};
}

Status TwoNetworks::set_up(const std::string& name, const std::string& lines, const std::string& directory) {
  const std::string errand = "ip-" + name;
  std::vector<std::string> command = enter(name);
  command.insert(command.end(), {sh_, "-euc", lines});
  if (auto started =
          children_.start({errand, std::move(command), fmt::format("{}/{}.log", directory, errand), SIGKILL});
      !started)
    return started;
  const TimeNs until = monotonic_ns() + network_timeout_ns;
  while (children_.running(errand) && monotonic_ns() < until) children_.poll(network_look_ns);
  if (children_.ended_well(errand)) return done;
  return Error{fmt::format("{}: {}", advice, children_.log_tail(errand, 3))};
}

Status TwoNetworks::open(const std::vector<std::string>& sky_addresses, const std::string& directory) {
  if (auto found = find_tools(); !found) return found;
  for (const std::string& name : {sky, client}) {
    if (auto held = hold(name, directory); !held) return held;
  }
  std::string lines = "ip link set lo up\n";
  for (const std::string& address : sky_addresses) lines += fmt::format("ip addr add {}/32 dev lo\n", address);
  lines += fmt::format(
      "ip link add client type veth peer name eth0 netns {0}\nip addr add {1}/32 dev client\nip link set client up\n"
      "ip route add {2}/32 dev client\n",
      children_.pid(client), sky_end, client_end);
  if (auto set = set_up(sky, lines, directory); !set) return set;
  return set_up(client,
                fmt::format("ip link set lo up\nip addr add {0}/32 dev eth0\nip link set eth0 up\n"
                            "ip route add {1}/32 dev eth0\nip route add {2} via {1} dev eth0 onlink\n",
                            client_end, sky_end, clients_network),
                directory);
}

}  // namespace ledgerline::hil
