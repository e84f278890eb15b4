#include "common/program/service_manager.hpp"

#include <pthread.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <utility>

#include "common/base/text.hpp"
#include "common/rt/loop_ticker.hpp"

namespace ledgerline {
namespace {

Result<std::int64_t> whole_number(const char* name, std::int64_t otherwise) {
  const std::string text = environment_variable(name);
  if (text.empty()) return otherwise;
  std::int64_t number = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), number);
  if (read.ec != std::errc() || read.ptr != text.data() + text.size() || number <= 0)
    return Error{std::string(name) + " is \"" + text + "\", not a number above 0"};
  return number;
}

// A datagram goes out each half of the manager's timeout. Halved this wakes the thread oftener for nothing, doubled a
// datagram may be late by a tenth of the timeout.
constexpr int looks_per_timeout = 20;

}  // namespace

Result<ServiceManager> ServiceManager::from_environment() {
  constexpr std::int64_t max_timeout_us = 86'400'000'000;
  const auto timeout_us = whole_number("WATCHDOG_USEC", 0);
  if (!timeout_us) return timeout_us.error();
  if (*timeout_us > max_timeout_us) return Error{"WATCHDOG_USEC is longer than a day"};
  const auto watched = whole_number("WATCHDOG_PID", ::getpid());
  if (!watched) return watched.error();
  ServiceManager manager(*watched == ::getpid() ? *timeout_us * ns_per_us : 0);

  const std::string socket = environment_variable("NOTIFY_SOCKET");
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
  return pace_.should_notify(now, progress) ? send("WATCHDOG=1") : done;
}

Status ServiceManager::send(const char* message) const {
  if (fd_ < 0) return done;
  const auto* to = reinterpret_cast<const sockaddr*>(&address_);
  if (::sendto(fd_, message, std::strlen(message), MSG_NOSIGNAL, to, address_size_) >= 0) return done;
  return Error{std::string("the service manager was not sent ") + message + ": " + std::strerror(errno)};
}

WatchdogThread::WatchdogThread(ServiceManager& manager, std::function<std::uint64_t()> progress, int priority)
    : manager_(manager), progress_(std::move(progress)) {
  if (manager.timeout_ns() == 0) return;
  // The program's signals are for its own threads.
  sigset_t all, before;
  sigfillset(&all);
  ::pthread_sigmask(SIG_SETMASK, &all, &before);
  thread_ = std::thread([this, priority] {
    ::pthread_setname_np(::pthread_self(), "watchdog");
    if (priority > 0) (void)schedule_fifo(priority);
    run(manager_.timeout_ns() / looks_per_timeout);
  });
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

WatchdogThread::~WatchdogThread() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    is_ending_ = true;
  }
  ending_.notify_all();
  thread_.join();
}

void WatchdogThread::run(TimeNs look_ns) {
  std::unique_lock lock(mutex_);
  while (!ending_.wait_for(lock, std::chrono::nanoseconds(look_ns), [this] { return is_ending_; })) {
    if (!manager_.alive(monotonic_ns(), progress_())) failed_.fetch_add(1, std::memory_order_relaxed);
  }
}

}  // namespace ledgerline
