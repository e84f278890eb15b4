#pragma once
#include <string>
#include <string_view>
#include <vector>

namespace ledgerline {

/// The releases of ROS 2 that [dds] ros_release may name, oldest first.
inline const std::vector<std::string>& ros_releases() {
  static const std::vector<std::string> names{"foxy", "galactic", "humble", "iron", "jazzy", "kilted", "rolling"};
  return names;
}

/// Foxy to Humble: other ids of nodes, and ROS_LOCALHOST_ONLY=1 for 127.0.0.1 alone. False of what is no such name.
inline bool is_before_iron(std::string_view release) {
  return release == "foxy" || release == "galactic" || release == "humble";
}

}  // namespace ledgerline
