#pragma once
#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "common/dds/raw.hpp"

/// What readers and writers are made of. Inside common/dds alone.

/// What Cyclone DDS asks of a type, answered for opaque CDR: keyless, bytes in and bytes out. Inside common/dds and its
/// tests alone.

namespace ledgerline::dds {

/// Counted where it happens, on threads of DDS.
struct RefusedCounters {
  std::atomic<std::uint64_t> malformed{0}, too_long{0};
  Refused read() const { return {malformed.load(), too_long.load()}; }
};

/// Cyclone's view of a type: its name. One for each reader and writer, so that each counts for itself. Made with one
/// reference, which dds_create_topic_sertype takes over.
ddsi_sertype* make_raw_type(const std::string& dds_type, std::shared_ptr<RefusedCounters> refused);

/// A message as it goes onto the wire; null, and counted, where it is refused. For dds_writecdr, which takes it over.
ddsi_serdata* make_raw_message(const ddsi_sertype* type, std::span<const std::uint8_t> cdr);
/// The bytes of a message that came in, none where it was refused; valid as long as it is.
std::span<const std::uint8_t> bytes_of(const ddsi_serdata* message);

struct QosDelete {
  void operator()(dds_qos_t* qos) const { dds_delete_qos(qos); }
};
using QosPtr = std::unique_ptr<dds_qos_t, QosDelete>;

/// Owns a reader or a writer and the topic under it. The participant must outlive it.
class Endpoint {
 public:
  Endpoint() = default;
  ~Endpoint();
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  /// Names as DDS has them ("rt/a", "pkg::msg::dds_::Type_").
  Status open_writer(dds_entity_t participant, const std::string& topic, const std::string& type, const Qos& qos);
  Status open_reader(dds_entity_t participant, const std::string& topic, const std::string& type, const Qos& qos,
                     dds_on_data_available_fn on_data, void* argument);
  /// `source_time_ns`: real time; 0: now.
  Status write(std::span<const std::uint8_t> cdr, TimeNs source_time_ns = 0);

  dds_entity_t handle() const { return handle_; }
  Refused refused() const { return refused_->read(); }

 private:
  Status open_topic(dds_entity_t participant, const std::string& topic, const std::string& type);

  std::shared_ptr<RefusedCounters> refused_ = std::make_shared<RefusedCounters>();
  ddsi_sertype* type_ = nullptr;  ///< the topic's
  dds_entity_t topic_ = 0;
  dds_entity_t handle_ = 0;
};

/// "nav_msgs/msg/Odometry" -> "nav_msgs::msg::dds_::Odometry_"; an error where ROS 2 does not allow it.
Result<std::string> dds_type(const std::string& ros_type);
/// The other way; empty where the name is none of ROS 2's.
std::string ros_topic(const std::string& dds_topic);
std::string ros_type(const std::string& dds_type);

/// A GUID as it stands on the wire.
using Guid = std::array<std::uint8_t, 16>;
Guid guid_of(dds_entity_t entity);

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
