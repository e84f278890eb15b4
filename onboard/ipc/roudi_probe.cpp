#include "onboard/ipc/roudi_probe.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace ledgerline::ipc {

namespace {

std::string socket_path(const std::string& name) { return "/tmp/" + name; }
std::string service_path(const std::string& name) { return "/run/ledgerline/" + name; }

Peer probe_path(const std::string& path, bool is_anybodys_folder) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) return Peer::gone;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  // In a folder where only owners may remove files it is the one that we ask below.
  struct stat info {};
  const bool is_there = ::lstat(path.c_str(), &info) == 0;
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return Peer::gone;
  const int failed = ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  const int error = errno;
  ::close(fd);
  if (failed == 0) {
    const bool is_own = is_there && S_ISSOCK(info.st_mode) && info.st_uid == ::geteuid();
    return is_own || !is_anybodys_folder ? Peer::alive : Peer::forbidden;
  }
  return error == EACCES || error == EPERM ? Peer::forbidden : Peer::gone;
}

}  // namespace

Peer probe(const std::string& name) { return probe_path(socket_path(name), true); }

Peer probe_service(const std::string& name) {
  const bool shares_memory = ::access("/dev/shm/iceoryx_mgmt", F_OK) == 0;
  return shares_memory ? probe_path(service_path(name), false) : Peer::gone;
}

Status check_names(const std::vector<std::string>& names) {
  for (const std::string& name : names) {
    const std::string path = socket_path(name);
    struct stat info {};
    if (::lstat(path.c_str(), &info) != 0) continue;
    const bool may_use = info.st_uid == ::geteuid() || ::geteuid() == 0;  // root replaces what others left
    if (may_use && (S_ISREG(info.st_mode) || S_ISSOCK(info.st_mode))) continue;
    return Error{
        fmt::format("{} belongs to another user, or is no plain file: remove it (as root, rm {})", path, path)};
  }
  return done;
}

std::uint64_t socket_inode(const std::string& name) {
  struct stat info {};
  return ::stat(socket_path(name).c_str(), &info) == 0 ? info.st_ino : 0;
}

std::vector<std::string> older_than_roudi(const std::vector<std::string>& names) {
  constexpr const char* roudi = "roudi";
  // A process has its socket when it joins, and RouDi a new one at each start.
  const auto is_older = [](const std::string& one, const std::string& other) {
    struct stat a {};
    struct stat b {};
    if (::stat(one.c_str(), &a) != 0 || ::stat(other.c_str(), &b) != 0) return false;
    return std::pair(a.st_mtim.tv_sec, a.st_mtim.tv_nsec) < std::pair(b.st_mtim.tv_sec, b.st_mtim.tv_nsec);
  };
  std::vector<std::string> older;
  for (const std::string& name : names) {
    const bool is_ours =
        probe(roudi) == Peer::alive && probe(name) == Peer::alive && is_older(socket_path(name), socket_path(roudi));
    const bool is_a_services = probe_service(roudi) == Peer::alive && probe_service(name) == Peer::alive &&
                               is_older(service_path(name), service_path(roudi));
    if (is_ours || is_a_services) older.push_back(name);
  }
  return older;
}

}  // namespace ledgerline::ipc
