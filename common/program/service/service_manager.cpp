#include "common/program/service/service_manager.hpp"

#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <utility>

namespace ledgerline {
namespace {

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

Result<std::int64_t> whole_number(const char* name, std::int64_t otherwise) {
  const std::string text = variable(name);
  if (text.empty()) return otherwise;
  std::int64_t number = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), number);
  if (read.ec != std::errc() || read.ptr != text.data() + text.size() || number <= 0)
    return Error{std::string(name) + " is \"" + text + "\", not a number above 0"};
  return number;
}

}  // namespace

Result<ServiceManager> ServiceManager::from_environment() {
  constexpr std::int64_t max_timeout_us = 86'400'000'000;
  const auto timeout_us = whole_number("WATCHDOG_USEC", 0);
  if (!timeout_us) return timeout_us.error();
  if (*timeout_us > max_timeout_us) return Error{"WATCHDOG_USEC is longer than a day"};
  const auto watched = whole_number("WATCHDOG_PID", ::getpid());
  if (!watched) return watched.error();
  ServiceManager manager(*watched == ::getpid() ? *timeout_us * ns_per_us : 0);

  const std::string socket = variable("NOTIFY_SOCKET");
  if (socket.empty()) return Result<ServiceManager>(std::move(manager));
  const bool abstract = socket[0] == '@';
  if ((!abstract && socket[0] != '/') || socket.size() < 2 || socket.size() >= sizeof manager.address_.sun_path)
    return Error{"NOTIFY_SOCKET is \"" + socket + "\": neither a path nor an abstract name (@...) of a unix socket"};
  manager.address_.sun_family = AF_UNIX;
  std::memcpy(manager.address_.sun_path, socket.data(), socket.size());
  if (abstract) manager.address_.sun_path[0] = '\0';
  // An abstract name is all bytes of its size; a path ends with a zero.
  manager.address_size_ = static_cast<unsigned>(offsetof(sockaddr_un, sun_path) + socket.size() + (abstract ? 0 : 1));
  manager.fd_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (manager.fd_ < 0) return Error{std::string("no socket for NOTIFY_SOCKET: ") + std::strerror(errno)};
  return Result<ServiceManager>(std::move(manager));
}

ServiceManager::ServiceManager(ServiceManager&& other) noexcept
    : pace_(other.pace_),
      fd_(std::exchange(other.fd_, -1)),
      address_(other.address_),
      address_size_(other.address_size_) {}

ServiceManager::~ServiceManager() {
  if (fd_ >= 0) ::close(fd_);
}

Status ServiceManager::ready() { return send("READY=1"); }

Status ServiceManager::alive(TimeNs now, std::uint64_t progress) {
  return pace_.due(now, progress) ? send("WATCHDOG=1") : done;
}

Status ServiceManager::send(const char* message) const {
  if (fd_ < 0) return done;
  const auto* to = reinterpret_cast<const sockaddr*>(&address_);
  if (::sendto(fd_, message, std::strlen(message), MSG_NOSIGNAL, to, address_size_) >= 0) return done;
  return Error{std::string("the service manager was not sent ") + message + ": " + std::strerror(errno)};
}

}  // namespace ledgerline
