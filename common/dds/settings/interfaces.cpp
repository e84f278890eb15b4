#include "common/dds/settings/interfaces.hpp"

#include <ifaddrs.h>
#include <net/if.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace ledgerline::dds {

Result<std::vector<Interface>> host_interfaces() {
  ifaddrs* all = nullptr;
  if (::getifaddrs(&all) != 0) return Error{std::string("cannot list the network interfaces: ") + std::strerror(errno)};
  std::vector<Interface> found;
  for (const ifaddrs* entry = all; entry; entry = entry->ifa_next) {
    auto known =
        std::find_if(found.begin(), found.end(), [&](const Interface& i) { return i.name == entry->ifa_name; });
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
