#include <dds/dds.h>
#include <dds/security/dds_security_api_defs.h>
#include <dirent.h>
#include <linux/filter.h>
#include <net/if_arp.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/dds/dds.hpp"
#include "common/dds/endpoint.hpp"
#include "common/dds/reach.hpp"

namespace ledgerline::dds {
namespace {

Result<std::uint32_t> domain_from_environment() {
  const std::string digits = environment_variable("ROS_DOMAIN_ID");
  if (digits.empty()) return std::uint32_t{0};
  const bool plain = digits.size() <= 3 && std::ranges::all_of(digits, [](char c) { return c >= '0' && c <= '9'; });
  if (!plain || std::stoul(digits) > 232)
    return Error{"ROS_DOMAIN_ID is '" + digits + "': give a number from 0 to 232"};
  return static_cast<std::uint32_t>(std::stoul(digits));
}

Status check(const Security& files) {
  for (const std::string& path :
       {files.identity_ca, files.certificate, files.private_key, files.governance, files.permissions}) {
    if (::access(path.c_str(), R_OK) != 0) return Error{"DDS Security: cannot read '" + path + "'"};
  }
  struct stat info {};
  if (::stat(files.private_key.c_str(), &info) != 0 || !is_private(info))
    return Error{"DDS Security: " + files.private_key + " may be read by others than its owner; run: chmod 600 " +
                 files.private_key};
  return done;
}

void use(const Security& files, dds_qos_t* qos) {
  const auto plugin = [qos](const std::string& what, const std::string& library, const std::string& function) {
    const std::string key = DDS_SEC_PROP_PREFIX + what + ".library.";
    dds_qset_prop(qos, (key + "path").c_str(), (LEDGERLINE_DDS_PLUGINS "/libdds_security_" + library + ".so").c_str());
    dds_qset_prop(qos, (key + "init").c_str(), ("init_" + function).c_str());
    dds_qset_prop(qos, (key + "finalize").c_str(), ("finalize_" + function).c_str());
  };
  plugin("auth", "auth", "authentication");
  plugin("crypto", "crypto", "crypto");
  plugin("access", "ac", "access_control");
  const auto file = [qos](const char* key, const std::string& path) {
    dds_qset_prop(qos, key, ("file:" + path).c_str());
  };
  file(DDS_SEC_PROP_AUTH_IDENTITY_CA, files.identity_ca);
  file(DDS_SEC_PROP_AUTH_IDENTITY_CERT, files.certificate);
  file(DDS_SEC_PROP_AUTH_PRIV_KEY, files.private_key);
  file(DDS_SEC_PROP_ACCESS_PERMISSIONS_CA, files.identity_ca);
  file(DDS_SEC_PROP_ACCESS_GOVERNANCE, files.governance);
  file(DDS_SEC_PROP_ACCESS_PERMISSIONS, files.permissions);
}

/// A domain made with a configuration that is not the environment's; deleting it ends DDS's threads in this process.
class OwnDomain {
 public:
  explicit OwnDomain(dds_entity_t handle) : handle_(handle) {}
  ~OwnDomain() { dds_delete(handle_); }
  OwnDomain(const OwnDomain&) = delete;
  OwnDomain& operator=(const OwnDomain&) = delete;

 private:
  dds_entity_t handle_;
};

struct MadeParticipant {
  std::shared_ptr<OwnDomain> domain;  ///< null: the environment's, or one that exists already by other means
  dds_entity_t handle = 0;
};

struct OpenSocket {
  int fd;
  std::uint64_t inode;
};

std::vector<OpenSocket> list_sockets() {
  std::vector<OpenSocket> found;
  const std::unique_ptr<DIR, int (*)(DIR*)> files(::opendir("/proc/self/fd"), &::closedir);
  if (!files) return found;
  while (const dirent* entry = ::readdir(files.get())) {
    struct stat info {};
    const int fd = std::atoi(entry->d_name);
    if (entry->d_name[0] != '.' && ::fstat(fd, &info) == 0 && S_ISSOCK(info.st_mode))
      found.push_back({fd, info.st_ino});
  }
  return found;
}

/// A port of IPv4's UDP that is bound on every address; else 0.
int udp_port(int fd) {
  int type = 0;
  socklen_t length = sizeof type;
  if (::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &length) != 0 || type != SOCK_DGRAM) return 0;
  sockaddr_in address{};
  length = sizeof address;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length) != 0 || address.sin_family != AF_INET) return 0;
  return address.sin_addr.s_addr == htonl(INADDR_ANY) ? ntohs(address.sin_port) : 0;
}

/// Inode numbers of this process's sockets.
std::set<std::uint64_t> open_sockets() {
  std::set<std::uint64_t> inodes;
  for (const OpenSocket& one : list_sockets()) inodes.insert(one.inode);
  return inodes;
}

/// Makes the kernel drop what reaches Cyclone's sockets of this domain by another interface than loopback. Cyclone
/// binds them to every address even where it is configured to use lo alone, so without this an outsider's datagrams
/// come in. `before`: the sockets from before the domain was made. An error if none of the domain's sockets is found or
/// one takes no filter.
Status hear_this_host_only(std::uint32_t domain, const std::set<std::uint64_t>& before) {
  // What goes from one address of a host to another comes by lo, too.
  sock_filter program[] = {
      BPF_STMT(BPF_LD | BPF_H | BPF_ABS, static_cast<std::uint32_t>(SKF_AD_OFF + SKF_AD_HATYPE)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ARPHRD_LOOPBACK, 0, 1),
      BPF_STMT(BPF_RET | BPF_K, 0xffffffff),
      BPF_STMT(BPF_RET | BPF_K, 0),
  };
  const sock_fprog filter{sizeof program / sizeof program[0], program};
  const int first = 7400 + 250 * static_cast<int>(domain);
  bool found = false;
  for (const OpenSocket& one : list_sockets()) {
    const int port = before.contains(one.inode) ? 0 : udp_port(one.fd);
    if (port < first || port >= first + 250) continue;
    if (::setsockopt(one.fd, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) != 0)
      return Error{std::string("DDS cannot be kept on this host: a socket takes no filter: ") + std::strerror(errno)};
    found = true;
  }
  if (!found) return Error{"DDS cannot be kept on this host: its sockets are not found in /proc/self/fd"};
  return done;
}

/// Collects what Cyclone says as long as it lives; one at a time.
class CycloneSays {
 public:
  CycloneSays() { dds_set_log_sink(&CycloneSays::take, this); }
  ~CycloneSays() { dds_set_log_sink(nullptr, nullptr); }
  CycloneSays(const CycloneSays&) = delete;
  CycloneSays& operator=(const CycloneSays&) = delete;

  std::vector<std::string> lines() const {
    const std::lock_guard lock(mutex_);
    return lines_;
  }
  std::string joined() const {
    std::string all;
    for (const std::string& line : lines()) all += (all.empty() ? "" : "; ") + line;
    return all;
  }

 private:
  static constexpr std::size_t max_lines = 32;
  static void take(void* self, const dds_log_data_t* data) {
    auto& says = *static_cast<CycloneSays*>(self);
    std::string line(data->message, data->size);
    while (!line.empty() && (line.back() == '\n' || line.back() == '\0')) line.pop_back();
    const std::lock_guard lock(says.mutex_);
    if (says.lines_.size() < max_lines) says.lines_.push_back(std::move(line));
  }

  mutable std::mutex mutex_;
  std::vector<std::string> lines_;
};

/// The configuration that a person wrote, as Cyclone is given it; empty: none, or ours.
std::string own_configuration(const Reach& reach) {
  if (reach.cyclone_config) return reach.cyclone_config->starts_with("file://") ? *reach.cyclone_config : "";
  const std::string uri = environment_variable("CYCLONEDDS_URI");
  return uri.empty() ? "" : "CYCLONEDDS_URI " + uri;
}

/// Null where the domain exists already by other means: it then keeps its own configuration.
Result<std::shared_ptr<OwnDomain>> own_domain(std::uint32_t id, const Reach& reach, const CycloneSays& says) {
  static std::map<std::uint32_t, std::weak_ptr<OwnDomain>> domains;
  if (auto existing = domains[id].lock()) return existing;
  const auto before = open_sockets();
  const dds_entity_t handle = dds_create_domain(id, reach.cyclone_config->c_str());
  if (handle == DDS_RETCODE_PRECONDITION_NOT_MET) return std::shared_ptr<OwnDomain>{};
  if (handle < 0) return Error{why_no_domain(id, says.joined(), own_configuration(reach))};
  auto made = std::make_shared<OwnDomain>(handle);
  if (reach.this_host_only) {
    if (auto heard = hear_this_host_only(id, before); !heard) return heard.error();
  }
  domains[id] = made;
  return made;
}

/// A participant in a domain that is made first where this process has none yet. What Cyclone says meanwhile goes into
/// the error, or else to the log.
Result<MadeParticipant> make_participant(std::uint32_t domain, const Reach& reach, const dds_qos_t* qos) {
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
  const CycloneSays says;
  MadeParticipant made;
  if (reach.cyclone_config) {
    auto own = own_domain(domain, reach, says);
    if (!own) return own.error();
    made.domain = *own;
  }
  made.handle = dds_create_participant(domain, qos, nullptr);
  if (made.handle < 0) {
    const std::string said = says.joined();
    return Error{made.domain ? "no DDS participant in domain " + std::to_string(domain) + ": " +
                                   dds_strretcode(made.handle) + (said.empty() ? "" : ": " + said)
                             : why_no_domain(domain, said, own_configuration(reach))};
  }
  for (const std::string& line : says.lines()) spdlog::warn("Cyclone DDS: {}", line);
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

  if (!options.cyclonedds.empty() && ::access(options.cyclonedds.c_str(), R_OK) != 0)
    return Error{"DDS: cannot read '" + options.cyclonedds + "', which the config names for Cyclone DDS"};
  const auto interfaces = host_interfaces();
  if (!interfaces) return interfaces.error();
  ParticipantOptions in_domain = options;
  in_domain.domain = domain;
  const auto reach = reach_of(in_domain, environment_variable("CYCLONEDDS_URI"), *interfaces);
  if (!reach) return reach.error();
  for (const std::string& warning : reach->warnings) spdlog::warn("{}", warning);
  const QosPtr qos(dds_create_qos());
  // How ROS 2 knows that a participant is one of its own.
  constexpr std::string_view enclave = "enclave=/;";
  if (!options.node.empty()) dds_qset_userdata(qos.get(), enclave.data(), enclave.size());
  if (options.security) {
    if (auto checked = check(*options.security); !checked) return checked.error();
    use(*options.security, qos.get());
  }
  const auto made = make_participant(domain, *reach, qos.get());
  if (!made) {
    return Error{made.error().message + (options.security ? " (with DDS Security: look at its files, too)" : "")};
  }
  // The participant goes before its domain.
  ParticipantPtr participant(new Participant(made->handle), [own = made->domain](const Participant* p) { delete p; });
  if (!options.node.empty()) {
    auto node = NodeInfo::create(made->handle, options.node, options.ros_release);
    if (!node) return node.error();
    participant->node_ = std::move(*node);
  }
  return participant;
}

Participant::Participant(int handle) : handle_(handle) {}

Participant::~Participant() {
  node_.reset();
  dds_delete(handle_);
}

}  // namespace ledgerline::dds
