#include "onboard/ipc/roudi_probe.hpp"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace ledgerline::ipc {

namespace {
std::string socket_path(const std::string& name) { return "/tmp/" + name; }
}  // namespace

Peer probe(const std::string& name) {
  const std::string path = socket_path(name);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) return Peer::gone;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return Peer::gone;
  const int failed = ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  const int error = errno;
  ::close(fd);
  if (failed == 0) return Peer::alive;
  return error == EACCES || error == EPERM ? Peer::forbidden : Peer::gone;
}

std::uint64_t socket_inode(const std::string& name) {
  struct stat info {};
  return ::stat(socket_path(name).c_str(), &info) == 0 ? info.st_ino : 0;
}

}  // namespace ledgerline::ipc
