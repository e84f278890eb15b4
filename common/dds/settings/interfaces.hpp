#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"

namespace ledgerline::dds {

/// A network interface of this host, as DDS sees it.
struct Interface {
  std::string name;
  bool up = false, loopback = false, multicast = false;
  bool has_address = false;  ///< of IPv4
};

/// In the kernel's order.
Result<std::vector<Interface>> host_interfaces();

}  // namespace ledgerline::dds
