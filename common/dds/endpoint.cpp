#include "common/dds/endpoint.hpp"

#include <dds/ddsi/q_radmin.h>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>
#include <string_view>
#include <vector>

#include "common/base/text.hpp"
#include "common/dds/dds.hpp"
#include "common/dds/reach.hpp"
#include "common/msg/cdr.hpp"
#include "common/msg/ros_releases.hpp"

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
  return is_before_iron(release.empty() ? environment_variable("ROS_DISTRO") : std::string(release)) ? 24 : 16;
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

namespace {

constexpr std::size_t header_bytes = 4;
constexpr std::uint8_t padding_bits = 3;  // of the header's last byte: bytes at the end that are none of the message's

struct RawType : ddsi_sertype {
  std::shared_ptr<RefusedCounters> refused;
  std::uint32_t number = 0;
};

/// Followed by its bytes, in one block. On its way out they are whole words with the padding in the header, as they are
/// sent; on its way in the padding is taken off again.
struct RawMessage : ddsi_serdata {
  std::uint32_t size = 0;
  std::uint8_t* bytes() { return reinterpret_cast<std::uint8_t*>(this + 1); }
  const std::uint8_t* bytes() const { return reinterpret_cast<const std::uint8_t*>(this + 1); }
};

const RawMessage& raw(const ddsi_serdata* message) { return *static_cast<const RawMessage*>(message); }

RefusedCounters& counters(const ddsi_sertype* type) { return *static_cast<const RawType*>(type)->refused; }

constexpr std::size_t whole_words(std::size_t size) { return (size + 3) & ~std::size_t{3}; }

/// As Cyclone allocates its own messages: this is C's side.
RawMessage* make(const ddsi_sertype* type, ddsi_serdata_kind kind, std::size_t size) {
  void* const memory = std::malloc(sizeof(RawMessage) + whole_words(size));
  if (!memory) return nullptr;
  auto* message = new (memory) RawMessage;
  ddsi_serdata_init(message, type, kind);
  message->hash = type->serdata_basehash;
  message->size = static_cast<std::uint32_t>(size);
  std::memset(message->bytes() + size, 0, whole_words(size) - size);
  return message;
}

bool good_size(const ddsi_sertype* type, std::size_t size, std::size_t largest) {
  if (size < header_bytes) ++counters(type).malformed;
  if (size > largest) ++counters(type).too_long;
  return size >= header_bytes && size <= largest;
}

bool is_plain_cdr(const std::uint8_t* header) { return header[0] == 0 && header[1] <= 1; }

void free_message(ddsi_serdata* message) { std::free(static_cast<RawMessage*>(message)); }

/// From the network: `copy(bytes)` writes `size` bytes. What is refused is handed on empty: DDS would write a line to
/// its log for each message that it gets null for, and so let an outsider fill the disk.
template <typename Copy>
ddsi_serdata* receive(const ddsi_sertype* type, ddsi_serdata_kind kind, std::size_t size, Copy copy) {
  // Without a key, a message that has the key alone (a writer disposes of its instance) says nothing.
  if (kind != SDK_DATA) return make(type, kind, 0);
  if (!good_size(type, size, whole_words(max_message_bytes))) return make(type, kind, 0);
  RawMessage* message = make(type, kind, size);
  if (!message) return nullptr;
  std::uint8_t* bytes = message->bytes();
  copy(bytes);
  const std::size_t padding = bytes[3] & padding_bits;
  if (!is_plain_cdr(bytes) || size - header_bytes < padding) {
    ++counters(type).malformed;
    message->size = 0;
    return message;
  }
  bytes[3] &= static_cast<std::uint8_t>(~padding_bits);
  message->size -= static_cast<std::uint32_t>(padding);
  return message;
}

ddsi_serdata* from_fragments(const ddsi_sertype* type, ddsi_serdata_kind kind, const nn_rdata* fragments,
                             std::size_t size) {
  return receive(type, kind, size, [=](std::uint8_t* bytes) {
    std::size_t at = 0;
    for (const nn_rdata* f = fragments; f; f = f->nextfrag) {
      const std::size_t end = std::min<std::size_t>(f->maxp1, size);  // fragments may overlap
      if (end <= at) continue;
      std::memcpy(bytes + at, NN_RMSG_PAYLOADOFF(f->rmsg, NN_RDATA_PAYLOAD_OFF(f)) + (at - f->min), end - at);
      at = end;
    }
    std::memset(bytes + at, 0, size - at);
  });
}

ddsi_serdata* from_pieces(const ddsi_sertype* type, ddsi_serdata_kind kind, ddsrt_msg_iovlen_t count,
                          const ddsrt_iovec_t* pieces, std::size_t size) {
  return receive(type, kind, size, [=](std::uint8_t* bytes) {
    std::size_t at = 0;
    for (ddsrt_msg_iovlen_t i = 0; i < count && at < size; ++i) {
      const std::size_t part = std::min<std::size_t>(pieces[i].iov_len, size - at);
      std::memcpy(bytes + at, pieces[i].iov_base, part);
      at += part;
    }
    std::memset(bytes + at, 0, size - at);
  });
}

ddsi_serdata* from_key_hash(const ddsi_sertype* type, const ddsi_keyhash*) { return make(type, SDK_KEY, 0); }

std::uint32_t size_of(const ddsi_serdata* message) { return raw(message).size; }

void copy_out(const ddsi_serdata* message, std::size_t offset, std::size_t size, void* to) {
  std::memcpy(to, raw(message).bytes() + offset, size);
}

ddsi_serdata* lend(const ddsi_serdata* message, std::size_t offset, std::size_t size, ddsrt_iovec_t* to) {
  to->iov_base = const_cast<std::uint8_t*>(raw(message).bytes() + offset);
  to->iov_len = size;
  return ddsi_serdata_ref(message);
}

void give_back(ddsi_serdata* message, const ddsrt_iovec_t*) { ddsi_serdata_unref(message); }

/// Without a key all messages are of one instance.
bool same_key(const ddsi_serdata*, const ddsi_serdata*) { return true; }

ddsi_serdata* to_key(const ddsi_serdata* message) {
  RawMessage* key = make(message->type, SDK_KEY, 0);
  if (key) key->type = nullptr;  // it outlives the type
  return key;
}

void key_hash(const ddsi_serdata*, ddsi_keyhash* hash, bool) { std::memset(hash, 0, sizeof *hash); }

/// For Cyclone's own trace.
std::size_t print(const ddsi_sertype*, const ddsi_serdata* message, char* to, std::size_t room) {
  return static_cast<std::size_t>(std::snprintf(to, room, "%u bytes of CDR", raw(message).size));
}

/// Left null: samples that are C structs. Nothing here writes or takes those.
const ddsi_serdata_ops message_operations = [] {
  ddsi_serdata_ops ops{};
  ops.eqkey = same_key;
  ops.get_size = size_of;
  ops.from_ser = from_fragments;
  ops.from_ser_iov = from_pieces;
  ops.from_keyhash = from_key_hash;
  ops.to_ser = copy_out;
  ops.to_ser_ref = lend;
  ops.to_ser_unref = give_back;
  ops.to_untyped = to_key;
  ops.free = free_message;
  ops.print = print;
  ops.get_keyhash = key_hash;
  return ops;
}();

void free_type(ddsi_sertype* type) {
  ddsi_sertype_fini(type);
  delete static_cast<RawType*>(type);
}

const ddsi_sertype_ops type_operations = [] {
  ddsi_sertype_ops ops{};
  ops.version = ddsi_sertype_v0;
  ops.free = free_type;
  ops.equal = [](const ddsi_sertype* a, const ddsi_sertype* b) { return a == b; };
  // Each is equal to itself alone. Cyclone keeps them in a table that doubles itself, up to gigabytes, when more than a
  // few have one hash.
  ops.hash = [](const ddsi_sertype* type) { return static_cast<const RawType*>(type)->number * 0x9E3779B1U; };
  return ops;
}();

}  // namespace

ddsi_sertype* make_raw_type(const std::string& dds_type, std::shared_ptr<RefusedCounters> refused) {
  static std::atomic<std::uint32_t> made{0};
  auto* type = new RawType{};
  ddsi_sertype_init(type, dds_type.c_str(), &type_operations, &message_operations, true);
  type->refused = std::move(refused);
  type->number = ++made;
  return type;
}

ddsi_serdata* make_raw_message(const ddsi_sertype* type, std::span<const std::uint8_t> cdr) {
  if (!good_size(type, cdr.size(), max_message_bytes)) return nullptr;
  if (!is_plain_cdr(cdr.data())) {
    ++counters(type).malformed;
    return nullptr;
  }
  RawMessage* message = make(type, SDK_DATA, cdr.size());
  if (!message) return nullptr;
  std::memcpy(message->bytes(), cdr.data(), cdr.size());
  message->size = static_cast<std::uint32_t>(whole_words(cdr.size()));
  std::uint8_t& options = message->bytes()[3];
  options = static_cast<std::uint8_t>((options & ~padding_bits) | (message->size - cdr.size()));
  return message;
}

std::span<const std::uint8_t> bytes_of(const ddsi_serdata* message) {
  return {raw(message).bytes(), raw(message).size};
}

}  // namespace ledgerline::dds
