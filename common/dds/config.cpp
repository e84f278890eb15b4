#include "common/dds/dds.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

#include "common/dds/reach.hpp"
#include "common/msg/ros_releases.hpp"

namespace ledgerline::dds {
namespace {

/// Each costs a packet for each of 120 ports every 8 s.
constexpr std::size_t max_peers = 32;

std::optional<Security> security(Config& config) {
  Security files;
  const std::pair<Key, std::string*> keys[] = {
      {{"dds.identity_ca", "DDS Security: the authority's certificate; with the four below, or none of the five"},
       &files.identity_ca},
      {{"dds.certificate", "of this program"}, &files.certificate},
      {{"dds.private_key", "its key; as [ledger] private_key"}, &files.private_key},
      {{"dds.governance", "what is encrypted, signed by the authority"}, &files.governance},
      {{"dds.permissions", "who may do what, signed by the authority"}, &files.permissions}};
  for (const auto& [key, file] : keys) *file = config.text(key, "");
  const auto is_named = [](const auto& key) { return !key.second->empty(); };
  const auto named = std::find_if(std::begin(keys), std::end(keys), is_named);
  if (named == std::end(keys)) return std::nullopt;
  for (const auto& key : keys) {
    if (!is_named(key)) config.wrong(named->first.name, fmt::format("needs {}, too", key.first.name));
  }
  return files;
}

/// An address of IPv4 or a host's name, either with a port; not its resolving.
bool is_host(const std::string& text) {
  const auto allowed = [](char c) { return contract::is_alphanumeric(c) || c == '.' || c == '-' || c == ':'; };
  return !text.empty() && text.size() <= 255 && std::ranges::all_of(text, allowed);
}

void reach(Config& config, ParticipantOptions& options) {
  options.local_only =
      config.boolean({"dds.local_only", "DDS stays on this machine; false: it may leave it; beats CYCLONEDDS_URI",
                      "true, unless CYCLONEDDS_URI is set"});
  options.interfaces = config.texts(
      {"dds.interfaces", "of DDS, with \"lo\" for programs of this machine; without local_only", "loopback"},
      max_interfaces);
  options.peers = config.texts(
      {"dds.peers", "hosts to look for where multicast does not go; with interfaces, or with local_only = false",
       "none"},
      max_peers);
  options.ros_release = config.text({"dds.ros_release",
                                     "ROS 2's release here, foxy to rolling: how nodes are announced and, with "
                                     "local_only, on which addresses neighbours are"},
                                    "");
  const auto& releases = ros_releases();
  if (!options.ros_release.empty() && std::ranges::find(releases, options.ros_release) == releases.end())
    config.wrong("dds.ros_release", fmt::format("must be one of {}", fmt::join(releases, ", ")));
  options.cyclonedds = config.text(
      {"dds.cyclonedds", "Cyclone DDS's own XML file, which decides; without local_only, interfaces and peers"}, "");

  if (!options.cyclonedds.empty() && options.local_only)
    config.wrong("dds.cyclonedds", "must not stand beside dds.local_only: the file says how far DDS reaches");
  for (const auto& [key, list] : {std::pair{"dds.interfaces", &options.interfaces}, {"dds.peers", &options.peers}}) {
    if (!options.cyclonedds.empty() && !list->empty())
      config.wrong(key, "must not stand beside dds.cyclonedds: the file says how far DDS reaches");
  }
  if (!options.interfaces.empty() && options.local_only)
    config.wrong("dds.interfaces", "must not stand beside dds.local_only: they say how far DDS reaches");
  for (std::size_t i = 0; i < options.interfaces.size(); ++i) {
    if (std::ranges::count(options.interfaces, options.interfaces[i]) > 1) {
      config.wrong("dds.interfaces", fmt::format("names '{}' twice", options.interfaces[i]));
      break;
    }
  }
  for (const std::string& peer : options.peers) {
    if (!is_host(peer)) config.wrong("dds.peers", fmt::format("'{}' is no address: give it like 10.0.0.7", peer));
  }
  if (!options.peers.empty() && options.interfaces.empty() && options.local_only.value_or(true))
    config.wrong("dds.peers", "needs dds.interfaces, or dds.local_only = false: DDS stays on this machine");
}

}  // namespace

ParticipantOptions participant_options(Config& config, const std::string& node) {
  ParticipantOptions options;
  reach(config, options);
  options.node = node;
  const auto domain = config.integer({"dds.domain", "DDS domain", "ROS_DOMAIN_ID, else 0"}, -1, 0, 232);
  if (domain >= 0) options.domain = static_cast<std::uint32_t>(domain);
  options.security = security(config);
  return options;
}

Result<ParticipantOptions> participant_options_of(const std::string& file, const std::string& node) {
  auto config = file.empty() ? Config::parse("", "") : Config::load(file);
  if (!config) return config.error();
  auto options = participant_options(*config, node);
  if (auto status = config->finish(); !status) return status.error();
  return options;
}

}  // namespace ledgerline::dds
