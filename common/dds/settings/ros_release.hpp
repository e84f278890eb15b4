#pragma once
#include <string>
#include <vector>

namespace ledgerline::dds {

/// The releases of ROS 2 that [dds] ros_release may name, oldest first.
inline const std::vector<std::string>& ros_releases() {
  static const std::vector<std::string> names{"foxy", "galactic", "humble", "iron", "jazzy", "kilted", "rolling"};
  return names;
}

}  // namespace ledgerline::dds
