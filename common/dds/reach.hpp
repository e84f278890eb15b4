#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/dds/dds.hpp"

namespace ledgerline::dds {

/// A network interface of this host, as DDS sees it.
struct Interface {
  std::string name;
  bool up = false, loopback = false, multicast = false;
  bool has_address = false;  ///< of IPv4
};

/// In the kernel's order.
Result<std::vector<Interface>> host_interfaces();

/// Cyclone's own limit.
constexpr std::size_t max_interfaces = 4;
/// A participant's ports are 7410 + 250 x domain + 2 x index and the next one: 120 fit in front of the next domain's.
/// Each participant asks all of these ports of this host, and of each of [dds] peers, every 8 s, so a higher index
/// costs everybody packets (docs/ros2.md).
constexpr int max_participants = 120;

/// How far a participant's domain reaches.
struct Reach {
  /// Of Cyclone, in place of CYCLONEDDS_URI; none: Cyclone looks for itself, at the environment, too.
  std::optional<std::string> cyclone_config;
  /// Cyclone's sockets must hear this host alone: it binds them to every address, whatever its configuration.
  bool this_host_only = false;
  std::vector<std::string> warnings;  ///< what a person would not expect
};

/// The config beats the environment. `uri`: CYCLONEDDS_URI, empty where it is not set. `host`: the interfaces that
/// there are; one that is needed but missing, down or without an IPv4 address is an error. Pure.
Result<Reach> reach_of(const ParticipantOptions& options, std::string_view uri, const std::vector<Interface>& host);

/// What a person needs to hear of a domain that did not start. `said`: Cyclone's own messages. `configuration`: of a
/// person's own, as Cyclone is given it: a file's URI, or XML; empty: none. Pure.
std::string why_no_domain(std::uint32_t domain, std::string_view said, std::string_view configuration = "");

}  // namespace ledgerline::dds
