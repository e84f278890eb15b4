#include "common/dds/reach.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "common/base/text.hpp"
#include "common/msg/ros_releases.hpp"

namespace ledgerline::dds {
namespace {

/// How an interface is used.
enum class Multicast { yes, no, as_cyclone_finds };

struct Used {
  std::string name;
  Multicast multicast;
};

/// Participants whose ports (RTPS: 7410 + 250 * domain + 2 * participant, and one more) are ports: fewer in domain 232.
int room_of(std::uint32_t domain) {
  return std::min(max_participants, (65'535 - 7'411 - 250 * static_cast<int>(domain)) / 2 + 1);
}

/// No interfaces: Cyclone's own choice. Discovery by multicast where an interface can do it, and by unicast to the
/// participants of the peers.
std::string cyclone_config(const std::vector<Used>& interfaces, const std::vector<std::string>& peers,
                           std::uint32_t domain) {
  std::string general;
  for (const Used& one : interfaces) {
    constexpr const char* multicast[] = {" multicast=\"true\"", " multicast=\"false\"", ""};
    general += fmt::format("<NetworkInterface name=\"{}\"{}/>", xml_text(one.name),
                           multicast[static_cast<std::size_t>(one.multicast)]);
  }
  if (!general.empty()) general = "<General><Interfaces>" + general + "</Interfaces></General>";
  std::string asked;
  for (const std::string& peer : peers) asked += fmt::format("<Peer address=\"{}\"/>", xml_text(peer));
  if (!asked.empty()) asked = "<Peers>" + asked + "</Peers>";
  return fmt::format(
      "<CycloneDDS><Domain id=\"any\">{}<Discovery><ParticipantIndex>auto</ParticipantIndex>"
      "<MaxAutoParticipantIndex>{}</MaxAutoParticipantIndex>{}</Discovery></Domain></CycloneDDS>",
      general, room_of(domain) - 1, asked);
}

constexpr const char* this_host = "127.0.0.1";

/// "lo" on every Linux.
constexpr const char* loopback_name = "lo";

Result<Interface> usable(const std::string& name, const std::vector<Interface>& host) {
  const auto found = std::ranges::find_if(host, [&](const Interface& i) { return i.name == name; });
  if (found == host.end()) {
    std::vector<std::string> names;
    for (const Interface& i : host) names.push_back(i.name);
    return Error{fmt::format("DDS: this host has no network interface '{}'; it has {}", name, fmt::join(names, ", "))};
  }
  if (!found->up)
    return Error{fmt::format("DDS: the network interface '{}' is down; run: ip link set {} up", name, name)};
  if (!found->has_address) return Error{fmt::format("DDS: the network interface '{}' has no IPv4 address", name)};
  return *found;
}

/// Loopback, with multicast whether or not lo is flagged for it: a fresh container's is not, and can.
Result<Reach> loopback(const ParticipantOptions& options, const std::vector<Interface>& host) {
  if (const auto lo = usable(loopback_name, host); !lo) return lo.error();
  std::vector<Used> interfaces{{loopback_name, Multicast::yes}};
  // From Iron on ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST lets a node announce any address of its host.
  if (!options.ros_release.empty() && !is_before_iron(options.ros_release)) {
    // Neighbours announce all their addresses, so one of each is enough. What is sent to them stays on this host.
    for (const Interface& i : host) {
      if (i.up && i.has_address && !i.loopback && interfaces.size() < max_interfaces)
        interfaces.push_back({i.name, Multicast::no});
    }
    if (interfaces.size() > 1) interfaces.front().multicast = Multicast::no;
  }
  return Reach{cyclone_config(interfaces, {this_host}, options.domain.value_or(0)), true, {}};
}

Result<Reach> named(const ParticipantOptions& options, const std::vector<Interface>& host) {
  Reach reach;
  std::vector<Used> interfaces;
  std::vector<std::string> peers = options.peers, deaf;
  reach.this_host_only = !options.interfaces.empty();
  for (const std::string& name : options.interfaces) {
    const auto found = usable(name, host);
    if (!found) return found.error();
    interfaces.push_back({name, found->loopback ? Multicast::yes : Multicast::as_cyclone_finds});
    if (found->loopback)
      peers.emplace_back(this_host);
    else
      reach.this_host_only = false;
    if (!found->loopback && !found->multicast) deaf.push_back(name);
  }
  if (!deaf.empty()) {
    reach.warnings.push_back(fmt::format("DDS: {} cannot multicast, so Cyclone finds others by unicast alone: {}",
                                         fmt::join(deaf, ", "),
                                         options.peers.empty() ? "name them in [dds] peers" : "those of [dds] peers"));
  }
  reach.cyclone_config = cyclone_config(interfaces, peers, options.domain.value_or(0));
  return reach;
}

}  // namespace

Result<Reach> reach_of(const ParticipantOptions& options, std::string_view uri, const std::vector<Interface>& host) {
  if (!options.cyclonedds.empty()) {
    Reach reach{"file://" + std::filesystem::absolute(options.cyclonedds).string(), false, {}};
    if (!uri.empty())
      reach.warnings.push_back("CYCLONEDDS_URI is set, but the config names " + options.cyclonedds + ", which decides");
    return reach;
  }
  if (!options.interfaces.empty() || !options.peers.empty()) {
    auto reach = named(options, host);
    if (reach && !uri.empty())
      reach->warnings.emplace_back("CYCLONEDDS_URI is set, but the config names interfaces or peers, which decide");
    return reach;
  }
  if (options.local_only.value_or(uri.empty())) {
    auto reach = loopback(options, host);
    if (reach && !uri.empty()) {
      reach->warnings.emplace_back(
          "CYCLONEDDS_URI is set, but the config says local_only = true: DDS stays on this machine");
    }
    return reach;
  }
  if (!options.local_only) {
    return Reach{
        std::nullopt,
        false,
        {"CYCLONEDDS_URI decides how far DDS reaches, since the config says nothing: local_only = true in [dds] keeps "
         "it on this machine"}};
  }
  Reach reach;
  if (!uri.empty())
    reach.warnings.emplace_back("DDS leaves this machine, as the config says, and CYCLONEDDS_URI decides how");
  return reach;
}

std::string why_no_domain(std::uint32_t domain, std::string_view said, std::string_view configuration) {
  const std::string head = fmt::format("DDS domain {} does not start: ", domain);
  if (said.find("free participant index") != std::string_view::npos) {
    const std::uint32_t first = 7410 + 250 * domain;
    return fmt::format(
        "{}programs on this host have taken every participant's ports of this domain (UDP, from {}; ours have room for "
        "{} programs, a configuration of your own for its MaxAutoParticipantIndex); end some, or use another domain",
        head, first, room_of(domain));
  }
  if (said.empty() && !configuration.empty())
    return fmt::format("{}Cyclone DDS does not say why; look at {}: its XML must have one root, <CycloneDDS>", head,
                       printable(configuration));
  if (said.empty()) return head + "Cyclone DDS does not say why";
  return head + std::string(said);
}

Result<std::vector<Interface>> host_interfaces() {
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return Error{std::string("cannot list the network interfaces: ") + std::strerror(errno)};
  std::vector<Interface> found;
  for (const ifaddrs* entry = all; entry; entry = entry->ifa_next) {
    auto known = std::ranges::find_if(found, [&](const Interface& i) { return i.name == entry->ifa_name; });
    if (known == found.end()) {
      found.push_back({.name = entry->ifa_name,
                       .up = (entry->ifa_flags & IFF_UP) != 0,
                       .loopback = (entry->ifa_flags & IFF_LOOPBACK) != 0,
                       .multicast = (entry->ifa_flags & IFF_MULTICAST) != 0,
                       .has_address = false});
      known = std::prev(found.end());
    }
    if (entry->ifa_addr && entry->ifa_addr->sa_family == AF_INET) known->has_address = true;
  }
  ::freeifaddrs(all);
  return found;
}

}  // namespace ledgerline::dds
