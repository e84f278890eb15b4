#include "common/dds/settings/this_host.hpp"

#include <dirent.h>
#include <linux/filter.h>
#include <net/if_arp.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <vector>

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

}  // namespace

std::set<std::uint64_t> open_sockets() {
  std::set<std::uint64_t> inodes;
  for (const OpenSocket& one : list_sockets()) inodes.insert(one.inode);
  return inodes;
}

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

}  // namespace ledgerline::dds
