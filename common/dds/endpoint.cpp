#include "common/dds/endpoint.hpp"

#include <algorithm>
#include <cstdlib>
#include <string_view>
#include <vector>

#include "common/dds/dds.hpp"
#include "common/dds/reach.hpp"
#include "common/msg/cdr.hpp"

namespace ledgerline::dds {

namespace {

struct ListenerDelete {
  void operator()(dds_listener_t* listener) const { dds_delete_listener(listener); }
};

QosPtr make_qos(const Qos& wanted) {
  QosPtr qos(dds_create_qos());
  dds_qset_reliability(qos.get(), wanted.reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       DDS_MSECS(100));
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, wanted.depth);
  dds_qset_durability(qos.get(), wanted.transient_local ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  // What a late joiner gets.
  if (wanted.transient_local)
    dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, wanted.depth, DDS_LENGTH_UNLIMITED,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  dds_qset_ignorelocal(qos.get(), DDS_IGNORELOCAL_PARTICIPANT);
  const dds_data_representation_id_t plain_cdr = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &plain_cdr);
  return qos;
}

Status check(const Qos& qos, const std::string& topic) {
  if (qos.depth < 1) return Error{topic + ": a history's depth is 1 or more, not " + std::to_string(qos.depth)};
  return done;
}

bool is_name_char(char c) { return contract::is_alphanumeric(c) || c == '_'; }

bool is_name(std::string_view text) {
  const auto is_alphabetic = [](char c) { return contract::is_alphanumeric(c) && !(c >= '0' && c <= '9'); };
  return !text.empty() && is_alphabetic(text.front()) && std::ranges::all_of(text, is_name_char);
}

std::vector<std::string_view> split(std::string_view text, std::string_view by) {
  std::vector<std::string_view> parts;
  for (std::size_t at; (at = text.find(by)) != std::string_view::npos; text.remove_prefix(at + by.size()))
    parts.push_back(text.substr(0, at));
  parts.push_back(text);
  return parts;
}

}  // namespace

Endpoint::~Endpoint() {
  // Waits for a running callback.
  if (handle_ > 0) dds_delete(handle_);
  if (topic_ > 0) dds_delete(topic_);
}

Status Endpoint::open_topic(dds_entity_t participant, const std::string& topic, const std::string& type) {
  type_ = make_raw_type(type, refused_);
  topic_ = dds_create_topic_sertype(participant, topic.c_str(), &type_, nullptr, nullptr, nullptr);
  if (topic_ > 0) return done;
  ddsi_sertype_unref(type_);
  return Error{"DDS topic " + topic + ": " + dds_strretcode(topic_)};
}

Status Endpoint::open_writer(dds_entity_t participant, const std::string& topic, const std::string& type,
                             const Qos& qos) {
  if (auto checked = check(qos, topic); !checked) return checked;
  if (auto opened = open_topic(participant, topic, type); !opened) return opened;
  handle_ = dds_create_writer(participant, topic_, make_qos(qos).get(), nullptr);
  if (handle_ < 0) return Error{"DDS writer of " + topic + ": " + dds_strretcode(handle_)};
  return done;
}

Status Endpoint::open_reader(dds_entity_t participant, const std::string& topic, const std::string& type,
                             const Qos& qos, dds_on_data_available_fn on_data, void* argument) {
  if (auto checked = check(qos, topic); !checked) return checked;
  if (auto opened = open_topic(participant, topic, type); !opened) return opened;
  const std::unique_ptr<dds_listener_t, ListenerDelete> listener(dds_create_listener(argument));
  dds_lset_data_available(listener.get(), on_data);
  handle_ = dds_create_reader(participant, topic_, make_qos(qos).get(), listener.get());
  if (handle_ < 0) return Error{"DDS reader of " + topic + ": " + dds_strretcode(handle_)};
  return done;
}

Status Endpoint::write(std::span<const std::uint8_t> cdr, TimeNs source_time_ns) {
  ddsi_serdata* message = make_raw_message(type_, cdr);
  if (!message)
    return Error{"a message of " + std::to_string(cdr.size()) +
                 " bytes is not sent: it must be plain CDR with its encapsulation header, of 4 to " +
                 std::to_string(max_message_bytes) + " bytes"};
  message->timestamp.v = source_time_ns;
  const dds_return_t code = source_time_ns == 0 ? dds_writecdr(handle_, message) : dds_forwardcdr(handle_, message);
  if (code < 0) return Error{std::string("DDS write: ") + dds_strretcode(code)};
  return done;
}

Result<std::string> dds_topic(const std::string& ros_topic) {
  const bool good = ros_topic.size() > 1 && ros_topic.front() == '/' && ros_topic.back() != '/' &&
                    ros_topic.find("//") == std::string::npos &&
                    std::ranges::all_of(ros_topic, [](char c) { return is_name_char(c) || c == '/'; });
  if (!good)
    return Error{"'" + ros_topic + "' is no ROS 2 topic: it begins with / and has a-z, A-Z, 0-9, _ and / only"};
  return "rt" + ros_topic;
}

Result<std::string> dds_type(const std::string& ros_type) {
  const auto parts = split(ros_type, "/");
  if (parts.size() != 3 || !std::ranges::all_of(parts, is_name))
    return Error{"'" + ros_type + "' is no ROS 2 type: give it like geometry_msgs/msg/Twist"};
  return std::string(parts[0]) + "::" + std::string(parts[1]) + "::dds_::" + std::string(parts[2]) + "_";
}

std::string ros_topic(const std::string& name) {
  if (!name.starts_with("rt/") || !dds_topic(name.substr(2))) return {};
  return name.substr(2);
}

std::string ros_type(const std::string& name) {
  const auto parts = split(name, "::");
  if (parts.size() != 4 || parts[2] != "dds_" || !parts[3].ends_with('_')) return {};
  const std::string type =
      std::string(parts[0]) + "/" + std::string(parts[1]) + "/" + std::string(parts[3].substr(0, parts[3].size() - 1));
  return dds_type(type) ? type : std::string{};
}

Guid guid_of(dds_entity_t entity) {
  dds_guid_t guid{};
  (void)dds_get_guid(entity, &guid);
  return std::to_array(guid.v);
}

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
  const std::string cdr = out.release();
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
