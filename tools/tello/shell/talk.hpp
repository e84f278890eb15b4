#pragma once
#include <netinet/in.h>
#include <array>
#include <cerrno>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "common/msg/onboard.hpp"
#include "common/rt/clock.hpp"
#include "onboard/link/shell/transport/udp.hpp"
#include "tools/tello/core/dialogue.hpp"

/// What is said to Tellos and heard of them, by loops that go round every few milliseconds.
namespace ledgerline::tello {

inline constexpr TimeNs pace_ns = 4 * ns_per_ms;  // between two datagrams: a subnet of 254 is asked within a second
inline constexpr std::size_t max_reads = 64;      // of one turn, so that a flood ends no timeout
inline constexpr std::size_t max_bytes = 1024;    // what Tello clients receive with

sockaddr_in socket_address(std::uint32_t address, std::uint16_t port);

/// pace_ns, or until something comes or a signal asks to end. Two sockets at most.
void wait(std::initializer_list<int> sockets);

/// False: nothing was sent. What cannot be sent is a lost datagram: the cores ask again.
bool send_text(const link::Descriptor& socket, std::uint32_t address, const std::string& text);

/// All that came from a Tello's port; `on_datagram` gets the address that it came from, and the bytes.
template <typename OnDatagram>
void read_all(int fd, OnDatagram on_datagram) {
  std::array<char, max_bytes> buffer{};
  for (std::size_t i = 0; i < max_reads; ++i) {
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t n =
        ::recvfrom(fd, buffer.data(), buffer.size(), MSG_DONTWAIT, reinterpret_cast<sockaddr*>(&from), &size);
    if (n < 0 && errno != ECONNREFUSED) return;
    if (n > 0 && ntohs(from.sin_port) == command_port)
      on_datagram(ntohl(from.sin_addr.s_addr), std::string_view(buffer.data(), static_cast<std::size_t>(n)));
  }
}

/// Asks all of them at once, few enough datagrams a second for any Wi-Fi, until each has answered or was given up.
/// `interface` empty: wherever routes lead. Ends early when a signal asks to.
Status query(std::vector<Found>& drones, const std::string& interface);

/// True once it is down; false when it was not seen down within `seconds`. Says on the log what came of it.
Result<bool> land(std::uint32_t address, const std::string& interface, double seconds);

/// From a file (its first line), or asked for at the terminal, without echo.
Result<std::string> read_password(const std::string& file);

}  // namespace ledgerline::tello
