#pragma once
#include <mutex>
#include <vector>

#include "common/dds/endpoint.hpp"

namespace ledgerline::dds {

/// Says on ros_discovery_info which readers and writers are of our node, so that ROS 2's tools list it
/// (rmw_dds_common/msg/ParticipantEntitiesInfo: the newest value holds, late joiners get it). Thread-safe.
class NodeInfo {
 public:
  /// `name`: "agent" or, in a namespace, "/fleet/agent". `ros_release`: "humble", "jazzy" ...; empty: ROS_DISTRO's.
  static Result<std::unique_ptr<NodeInfo>> create(dds_entity_t participant, const std::string& name,
                                                  const std::string& ros_release);

  Status add_reader(dds_entity_t reader);
  Status add_writer(dds_entity_t writer);
  /// Before it is ended.
  void remove(dds_entity_t endpoint);

 private:
  NodeInfo() = default;
  Status publish();

  std::string space_, name_;
  std::size_t gid_bytes_ = 0;
  Guid participant_{};
  std::mutex mutex_;
  std::vector<Guid> readers_, writers_;
  Endpoint info_;
};

}  // namespace ledgerline::dds
