#include "common/dds/domain.hpp"

#include <dirent.h>
#include <linux/filter.h>
#include <net/if_arp.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <vector>

#include "common/base/log.hpp"

namespace ledgerline::dds {
namespace {

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

/// Null where the domain exists already by other means: it then keeps its own configuration.
Result<std::shared_ptr<OwnDomain>> own_domain(std::uint32_t id, const Reach& reach, const CycloneSays& says) {
  static std::map<std::uint32_t, std::weak_ptr<OwnDomain>> domains;
  if (auto existing = domains[id].lock()) return existing;
  const auto before = open_sockets();
  const dds_entity_t handle = dds_create_domain(id, reach.cyclone_config->c_str());
  if (handle == DDS_RETCODE_PRECONDITION_NOT_MET) return std::shared_ptr<OwnDomain>{};
  if (handle < 0) return Error{why_no_domain(id, says.joined())};
  auto made = std::make_shared<OwnDomain>(handle);
  if (reach.this_host_only) {
    if (auto heard = hear_this_host_only(id, before); !heard) return heard.error();
  }
  domains[id] = made;
  return made;
}

}  // namespace

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
                             : why_no_domain(domain, said)};
  }
  for (const std::string& line : says.lines()) spdlog::warn("Cyclone DDS: {}", line);
  return made;
}

}  // namespace ledgerline::dds
