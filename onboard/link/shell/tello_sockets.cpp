#include "onboard/link/shell/tello_sockets.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace ledgerline::link {
namespace {

std::string text(const sockaddr_in& address) {
  std::array<char, INET_ADDRSTRLEN> host{};
  ::inet_ntop(AF_INET, &address.sin_addr, host.data(), host.size());
  return fmt::format("{}:{}", host.data(), ntohs(address.sin_port));
}

Result<int> open_socket(const sockaddr_in& address, bool reuse) {
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) return Error{fmt::format("no UDP socket: {}", std::strerror(errno))};
  const int on = 1;
  // A simulator's and another client's sockets may share the port on other addresses.
  if (reuse) ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    const int error = errno;
    ::close(fd);
    return Error{fmt::format("cannot listen on {}: {}; is another Tello client running? Else set [state] listen",
                             text(address), std::strerror(error))};
  }
  return fd;
}

}  // namespace

Result<TelloSockets> TelloSockets::create(const ShellSettings& settings) {
  TelloSockets sockets;
  sockaddr_in any{};
  any.sin_family = AF_INET;
  auto command = open_socket(any, false);
  if (!command) return command.error();
  sockets.command_fd_ = *command;
  auto state = open_socket(settings.state_listen, true);
  if (!state) return state.error();
  sockets.state_fd_ = *state;
  for (const DroneSettings& drone : settings.link.drones) sockets.numbers_.push_back(drone.number);
  sockets.addresses_ = settings.addresses;
  sockets.buffers_.resize(max_received);
  return sockets;
}

TelloSockets::TelloSockets(TelloSockets&& other) noexcept
    : command_fd_(std::exchange(other.command_fd_, -1)),
      state_fd_(std::exchange(other.state_fd_, -1)),
      numbers_(std::move(other.numbers_)),
      addresses_(std::move(other.addresses_)),
      buffers_(std::move(other.buffers_)) {}

TelloSockets::~TelloSockets() {
  if (command_fd_ >= 0) ::close(command_fd_);
  if (state_fd_ >= 0) ::close(state_fd_);
}

std::span<const Received> TelloSockets::receive() noexcept {
  count_ = 0;
  receive_from(command_fd_, Port::answer);
  receive_from(state_fd_, Port::state);
  return {received_.data(), count_};
}

void TelloSockets::receive_from(int fd, Port port) noexcept {
  // Strangers' datagrams count too: a flood must not hold the loop, nor one port starve the other.
  for (std::size_t reads = 0; reads < max_received / 2; ++reads) {
    sockaddr_in from{};
    socklen_t size = sizeof from;
    auto& buffer = buffers_[count_];
    const ssize_t n =
        ::recvfrom(fd, buffer.data(), buffer.size(), MSG_DONTWAIT, reinterpret_cast<sockaddr*>(&from), &size);
    // A port that nobody listens on answers by ICMP, which shows here as an error of its own: go on reading.
    if (n < 0 && (errno == ECONNREFUSED || errno == EINTR)) continue;
    if (n < 0) return;
    for (std::size_t i = 0; i < addresses_.size(); ++i) {
      if (addresses_[i].sin_addr.s_addr != from.sin_addr.s_addr) continue;
      received_[count_++] = {numbers_[i], port, {buffer.data(), static_cast<std::size_t>(n)}};
      break;
    }
  }
}

bool TelloSockets::send(const ToSend& message) noexcept {
  for (std::size_t i = 0; i < numbers_.size(); ++i) {
    if (numbers_[i] != message.drone) continue;
    const std::string_view bytes = message.command.view();
    const ssize_t n = ::sendto(command_fd_, bytes.data(), bytes.size(), MSG_DONTWAIT,
                               reinterpret_cast<const sockaddr*>(&addresses_[i]), sizeof addresses_[i]);
    return n == static_cast<ssize_t>(bytes.size());
  }
  return false;
}

}  // namespace ledgerline::link
