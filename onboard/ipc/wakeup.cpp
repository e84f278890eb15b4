#include "onboard/ipc/ipc.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace ledgerline::ipc {
namespace {

Result<sockaddr_un> address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path)
    return Error{fmt::format("{}: longer than a socket's name may be ({})", path, sizeof address.sun_path - 1)};
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  return address;
}

int datagram_socket() { return ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0); }

Error error(const std::string& path, const char* cure) {
  return Error{fmt::format("{}: {}{}", path, std::strerror(errno), cure)};
}

}  // namespace

Result<std::unique_ptr<WakeupSink>> WakeupSink::create(const std::string& path) {
  const auto address = address_of(path);
  if (!address) return address.error();
  const int fd = datagram_socket();
  if (fd < 0) return error(path, "");
  std::unique_ptr<WakeupSink> wakeup(new WakeupSink(fd, path));
  // Before it has a name: at no moment may another user notify.
  if (::fchmod(fd, S_IRUSR | S_IWUSR) != 0) return error(path, "");
  if (::unlink(path.c_str()) != 0 && errno != ENOENT)
    return error(path, ": remove it, or run as the user that owns it");
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&*address), sizeof *address) != 0) return error(path, "");
  return wakeup;
}

WakeupSink::~WakeupSink() {
  ::close(fd_);
  ::unlink(path_.c_str());
}

bool WakeupSink::clear() noexcept {
  bool notified = false;
  for (char byte = 0; ::recv(fd_, &byte, 1, MSG_DONTWAIT) >= 0;) notified = true;
  return notified;
}

Result<WakeupSource> WakeupSource::create(const std::string& path) {
  const auto address = address_of(path);
  if (!address) return address.error();
  const int fd = datagram_socket();
  if (fd < 0) return error(path, "");
  return WakeupSource(fd, *address);
}

WakeupSource::WakeupSource(WakeupSource&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)), address_(other.address_) {}

WakeupSource::~WakeupSource() {
  if (fd_ >= 0) ::close(fd_);
}

void WakeupSource::notify() noexcept {
  (void)!::sendto(fd_, "", 1, MSG_DONTWAIT | MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&address_),
                  sizeof address_);
}

}  // namespace ledgerline::ipc
