#include "sim/shell/drone_sockets.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "common/base/log.hpp"
#include "common/base/text.hpp"

namespace ledgerline::sim {
namespace {

sockaddr_in to_sockaddr(const Endpoint& endpoint) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(endpoint.address);
  address.sin_port = htons(endpoint.port);
  return address;
}

/// Held as long as the descriptor is open; the kernel lets go of it however the process ends.
Result<int> lock_address(std::uint32_t address) {
  const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return Error{fmt::format("no Unix socket: {}", std::strerror(errno))};
  const std::string name = "ledgerline-sim@" + ipv4_text(address);
  sockaddr_un place{};
  place.sun_family = AF_UNIX;
  std::copy(name.begin(), name.end(), place.sun_path + 1);
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  if (bind(fd, reinterpret_cast<const sockaddr*>(&place), length) == 0) return fd;
  const int why = errno;
  close(fd);
  return Error{fmt::format("another ledgerline-sim holds {} ({}): end it, or choose other addresses with --address",
                           ipv4_text(address), std::strerror(why))};
}

Result<int> bind_drone(std::uint32_t address) {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return Error{fmt::format("no UDP socket: {}", std::strerror(errno))};
  const int on = 1;
  const sockaddr_in place = to_sockaddr({address, command_port});
  if (setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
      bind(fd, reinterpret_cast<const sockaddr*>(&place), sizeof place) == 0)
    return fd;
  const int why = errno;
  close(fd);
  return Error{
      fmt::format("cannot bind {}:{}: {} (a Tello client on this host that binds 0.0.0.0:{} without SO_REUSEADDR? "
                  "Run it in a network namespace of its own)",
                  ipv4_text(address), command_port, std::strerror(why), command_port)};
}

}  // namespace

Result<DroneSockets> DroneSockets::open(std::uint32_t first_address, int drones) {
  DroneSockets sockets;
  for (int i = 0; i < drones; ++i) {
    const std::uint32_t address = first_address + static_cast<std::uint32_t>(i);
    const auto lock = lock_address(address);
    if (!lock) return lock.error();
    sockets.locks_.push_back(*lock);
    const auto fd = bind_drone(address);
    if (!fd) return fd.error();
    sockets.sockets_.push_back(*fd);
    sockets.warned_.push_back(false);
  }
  return sockets;
}

DroneSockets::DroneSockets(DroneSockets&& other) noexcept
    : sockets_(std::exchange(other.sockets_, {})),
      locks_(std::exchange(other.locks_, {})),
      warned_(std::move(other.warned_)) {}

DroneSockets::~DroneSockets() {
  for (const int fd : sockets_) close(fd);
  for (const int fd : locks_) close(fd);
}

bool DroneSockets::wait(TimeNs until, const sigset_t& signals_while_waiting) {
  std::array<pollfd, max_drones> polled{};
  for (std::size_t i = 0; i < sockets_.size(); ++i) polled[i] = {sockets_[i], POLLIN, 0};
  const TimeNs left = std::max<TimeNs>(0, until - monotonic_ns());
  const timespec timeout{left / ns_per_s, left % ns_per_s};
  next_ = 0;
  taken_ = 0;
  return ppoll(polled.data(), sockets_.size(), &timeout, &signals_while_waiting) >= 0 || errno != EINTR;
}

bool DroneSockets::receive(Received& out) {
  for (; next_ < sockets_.size(); ++next_, taken_ = 0) {
    if (taken_ == max_at_once) continue;
    sockaddr_in from{};
    socklen_t length = sizeof from;
    const ssize_t got =
        recvfrom(sockets_[next_], buffer_.data(), buffer_.size(), 0, reinterpret_cast<sockaddr*>(&from), &length);
    if (got < 0) continue;  // nothing there, or an ICMP error about an earlier answer to a client that is gone
    out.drone = static_cast<DroneNumber>(next_ + 1);
    out.from = {ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)};
    out.bytes = std::string_view(buffer_.data(), static_cast<std::size_t>(got));
    ++taken_;
    return true;
  }
  return false;
}

void DroneSockets::send(const Outgoing& datagram) {
  const std::size_t i = datagram.drone - 1u;
  const sockaddr_in to = to_sockaddr(datagram.to);
  if (sendto(sockets_[i], datagram.bytes.data(), datagram.bytes.size(), MSG_DONTWAIT,
             reinterpret_cast<const sockaddr*>(&to), sizeof to) >= 0)
    return;
  ++unsent_;
  if (!warned_[i])
    spdlog::warn("tello{}: a datagram to {}:{} was not sent: {}", datagram.drone, ipv4_text(datagram.to.address),
                 datagram.to.port, std::strerror(errno));
  warned_[i] = true;
}

}  // namespace ledgerline::sim
