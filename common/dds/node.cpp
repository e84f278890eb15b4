#include "common/dds/node.hpp"

#include <cstdlib>
#include <string_view>

#include "common/dds/dds.hpp"
#include "common/dds/settings/reach.hpp"
#include "common/msg/cdr.hpp"

namespace ledgerline::dds {
namespace {

/// rmw_dds_common/msg/Gid: 16 bytes since Iron, 24 before. Where the config does not say which release is used here,
/// ROS 2's setup files do.
std::size_t gid_bytes_of(std::string_view release) {
  const char* distro = std::getenv("ROS_DISTRO");
  const std::string_view name = !release.empty() ? release : distro ? distro : "";
  return is_before_iron(name) ? 24 : 16;
}

void put_gid(CdrWriter& out, const Guid& guid, std::size_t bytes) {
  out.put(guid);
  for (std::size_t i = guid.size(); i < bytes; ++i) out.put(std::uint8_t{0});
}

void put_gids(CdrWriter& out, const std::vector<Guid>& guids, std::size_t bytes) {
  out.put(static_cast<std::uint32_t>(guids.size()));
  for (const Guid& guid : guids) put_gid(out, guid, bytes);
}

}  // namespace

Result<std::unique_ptr<NodeInfo>> NodeInfo::create(dds_entity_t participant, const std::string& name,
                                                   const std::string& ros_release) {
  // A node's full name follows the rules of a topic's.
  const std::string full = name.starts_with('/') ? name : "/" + name;
  if (!dds_topic(full)) return Error{"'" + name + "' is no name of a ROS 2 node: give it like agent or /fleet/agent"};
  std::unique_ptr<NodeInfo> node(new NodeInfo);
  const std::size_t slash = full.rfind('/');
  node->space_ = slash == 0 ? "/" : full.substr(0, slash);
  node->name_ = full.substr(slash + 1);
  node->gid_bytes_ = gid_bytes_of(ros_release);
  node->participant_ = guid_of(participant);
  if (auto opened = node->info_.open_writer(participant, "ros_discovery_info",
                                            "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_",
                                            {.reliable = true, .transient_local = true, .depth = 1});
      !opened)
    return opened.error();
  if (auto said = node->publish(); !said) return said.error();
  return node;
}

Status NodeInfo::publish() {
  CdrWriter out;
  put_gid(out, participant_, gid_bytes_);
  out.put(std::uint32_t{1});
  out.put(std::string_view(space_));
  out.put(std::string_view(name_));
  put_gids(out, readers_, gid_bytes_);
  put_gids(out, writers_, gid_bytes_);
  const std::string cdr = out.take();
  return info_.write({reinterpret_cast<const std::uint8_t*>(cdr.data()), cdr.size()});
}

Status NodeInfo::add_reader(dds_entity_t reader) {
  const std::lock_guard lock(mutex_);
  readers_.push_back(guid_of(reader));
  return publish();
}

Status NodeInfo::add_writer(dds_entity_t writer) {
  const std::lock_guard lock(mutex_);
  writers_.push_back(guid_of(writer));
  return publish();
}

void NodeInfo::remove(dds_entity_t endpoint) {
  const std::lock_guard lock(mutex_);
  const Guid guid = guid_of(endpoint);
  std::erase(readers_, guid);
  std::erase(writers_, guid);
  (void)publish();  // one who does not hear it learns from DDS that the endpoint is gone
}

}  // namespace ledgerline::dds
