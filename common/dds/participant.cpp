#include <dds/dds.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <mutex>
#include <string>

#include "common/dds/dds.hpp"

namespace ledgerline::dds {
namespace {

// Discovery by multicast where lo can do it, and by unicast to the first participants of this host where it cannot: a
// fresh container's lo has no MULTICAST flag. Neither leaves the machine.
constexpr const char* local_config = R"(
<CycloneDDS><Domain id="any">
  <General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>31</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers>
  </Discovery>
</Domain></CycloneDDS>)";

Result<std::uint32_t> domain_from_environment() {
  const char* text = std::getenv("ROS_DOMAIN_ID");
  if (!text || !*text) return std::uint32_t{0};
  const std::string digits = text;
  const bool plain =
      digits.size() <= 3 && std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; });
  if (!plain || std::stoul(digits) > 232)
    return Error{"ROS_DOMAIN_ID is '" + digits + "': give a number from 0 to 232"};
  return static_cast<std::uint32_t>(std::stoul(digits));
}

/// A domain made with our configuration; deleting it ends DDS's threads in this process.
class LocalDomain {
 public:
  explicit LocalDomain(dds_entity_t handle) : handle_(handle) {}
  ~LocalDomain() { dds_delete(handle_); }
  LocalDomain(const LocalDomain&) = delete;
  LocalDomain& operator=(const LocalDomain&) = delete;

 private:
  dds_entity_t handle_;
};

/// Null where the domain exists already by other means: it then keeps its own configuration.
Result<std::shared_ptr<LocalDomain>> local_domain(std::uint32_t id) {
  static std::mutex mutex;
  static std::map<std::uint32_t, std::weak_ptr<LocalDomain>> domains;
  const std::lock_guard lock(mutex);
  if (auto existing = domains[id].lock()) return existing;
  const dds_entity_t handle = dds_create_domain(id, local_config);
  if (handle == DDS_RETCODE_PRECONDITION_NOT_MET) return std::shared_ptr<LocalDomain>{};
  if (handle < 0)
    return Error{std::string("DDS on loopback does not start: ") + dds_strretcode(handle) +
                 " (is lo up? try: ip link set lo up)"};
  auto made = std::make_shared<LocalDomain>(handle);
  domains[id] = made;
  return made;
}

}  // namespace

Result<ParticipantPtr> Participant::create(const ParticipantOptions& options) {
  std::uint32_t domain = 0;
  if (options.domain) {
    domain = *options.domain;
  } else {
    auto from_environment = domain_from_environment();
    if (!from_environment) return from_environment.error();
    domain = *from_environment;
  }

  std::shared_ptr<LocalDomain> local;
  const char* uri = std::getenv("CYCLONEDDS_URI");
  if (options.local_only && (!uri || !*uri)) {
    auto made = local_domain(domain);
    if (!made) return made.error();
    local = *made;
  }
  const dds_entity_t handle = dds_create_participant(domain, nullptr, nullptr);
  if (handle < 0)
    return Error{"no DDS participant in domain " + std::to_string(domain) + ": " + dds_strretcode(handle) +
                 " (the reason is in Cyclone's own message above; check CYCLONEDDS_URI and the network interfaces)"};
  // The participant goes before its domain.
  return ParticipantPtr(new Participant(handle), [local](const Participant* participant) { delete participant; });
}

Participant::~Participant() { dds_delete(handle_); }

Result<std::string> dds_topic(const std::string& ros_topic) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '/';
  };
  const bool good = ros_topic.size() > 1 && ros_topic.front() == '/' && ros_topic.back() != '/' &&
                    ros_topic.find("//") == std::string::npos &&
                    std::all_of(ros_topic.begin(), ros_topic.end(), allowed);
  if (!good)
    return Error{"'" + ros_topic + "' is no ROS 2 topic: it begins with / and has letters, digits, _ and / only"};
  return "rt" + ros_topic;
}

}  // namespace ledgerline::dds
