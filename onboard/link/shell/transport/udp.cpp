#include "onboard/link/shell/transport/udp.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/errqueue.h>
#include <linux/net_tstamp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace ledgerline::link {

std::string text(const sockaddr_in& address) {
  std::array<char, INET_ADDRSTRLEN> host{};
  ::inet_ntop(AF_INET, &address.sin_addr, host.data(), host.size());
  return fmt::format("{}:{}", host.data(), ntohs(address.sin_port));
}

Result<Descriptor> open_udp(const std::string& interface) {
  Descriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (socket.get() < 0) return Error{fmt::format("no UDP socket: {}", std::strerror(errno))};
  if (interface.empty() || ::setsockopt(socket.get(), SOL_SOCKET, SO_BINDTODEVICE, interface.c_str(),
                                        static_cast<socklen_t>(interface.size())) == 0)
    return socket;
  if (errno == EPERM)
    return Error{
        fmt::format("this process may not choose interface {}: before Linux 5.7 that takes CAP_NET_RAW (in its unit "
                    "AmbientCapabilities=CAP_NET_RAW, or setcap cap_net_raw+ep on the program)",
                    interface)};
  if (errno == ENODEV) return Error{fmt::format("there is no interface {} (`ip link` lists them)", interface)};
  return Error{fmt::format("interface {}: {}", interface, std::strerror(errno))};
}

Status listen_alone(const Descriptor& socket, const sockaddr_in& address) {
  if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) return done;
  return Error{fmt::format("cannot listen on {}: {}; is another Tello client running? Else set [state] listen",
                           text(address), std::strerror(errno))};
}

Status listen_beside(std::span<const int> own, const Descriptor& socket, const sockaddr_in& address) {
  const Status alone = listen_alone(socket, address);
  if (alone || own.empty()) return alone;
  const auto share = [&](int on) {
    for (const int fd : own) ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    ::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  };
  share(1);
  const Status listening = listen_alone(socket, address);
  share(0);
  return listening;
}

bool connect_to(const Descriptor& socket, const sockaddr_in& address) noexcept {
  return ::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

Status stamp_sends(const Descriptor& socket) {
  const int flags = SOF_TIMESTAMPING_TX_SOFTWARE | SOF_TIMESTAMPING_SOFTWARE | SOF_TIMESTAMPING_OPT_TSONLY;
  if (::setsockopt(socket.get(), SOL_SOCKET, SO_TIMESTAMPING, &flags, sizeof flags) == 0) return done;
  return Error{fmt::format("no time stamps of what is sent: {}", std::strerror(errno))};
}

std::optional<TimeNs> sent_at(const Descriptor& socket, TimeNs since_ns) noexcept {
  constexpr std::size_t most = 4;  // of datagrams to one drone in a turn
  std::array<std::array<char, 256>, most> controls{};
  std::array<mmsghdr, most> messages{};
  for (std::size_t i = 0; i < most; ++i) {
    messages[i].msg_hdr.msg_control = controls[i].data();
    messages[i].msg_hdr.msg_controllen = controls[i].size();
  }
  const int count = ::recvmmsg(socket.get(), messages.data(), most, MSG_ERRQUEUE | MSG_DONTWAIT, nullptr);
  for (int i = 0; i < count; ++i) {
    msghdr& message = messages[static_cast<std::size_t>(i)].msg_hdr;
    for (cmsghdr* part = CMSG_FIRSTHDR(&message); part != nullptr; part = CMSG_NXTHDR(&message, part)) {
      if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SCM_TIMESTAMPING) continue;
      scm_timestamping stamps{};
      std::memcpy(&stamps, CMSG_DATA(part), sizeof stamps);
      const TimeNs at_ns = stamps.ts[0].tv_sec * ns_per_s + stamps.ts[0].tv_nsec;
      if (at_ns >= since_ns) return at_ns;
    }
  }
  return std::nullopt;
}

bool same_interface(int one, int other) noexcept {
  const auto index = [](int fd) {
    int value = 0;
    socklen_t size = sizeof value;
    ::getsockopt(fd, SOL_SOCKET, SO_BINDTOIFINDEX, &value, &size);
    return value;
  };
  return index(one) == index(other);
}

bool same_address(int one, int other) noexcept {
  const auto own = [](int fd) {
    sockaddr_in address{};
    socklen_t size = sizeof address;
    ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size);
    return address.sin_addr.s_addr;
  };
  return own(one) == own(other);
}

Status put_in_place_of(int old, Descriptor replacement) {
  if (::dup3(replacement.get(), old, O_CLOEXEC) >= 0) return done;
  return Error{fmt::format("no socket in place of another: {}", std::strerror(errno))};
}

}  // namespace ledgerline::link
