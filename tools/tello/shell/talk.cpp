#include "tools/tello/shell/talk.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/program/stop_signals.hpp"
#include "onboard/link/shell/sockets/udp.hpp"
#include "tools/tello/core/landing.hpp"
#include "tools/tello/core/places.hpp"

namespace ledgerline::tello {
namespace {

constexpr std::uint16_t command_port = 8889, state_port = 8890;
constexpr TimeNs pace_ns = 4 * ns_per_ms;  // between two datagrams: a subnet of 254 is asked within a second
constexpr std::size_t max_reads = 64;      // of one turn, so that a flood ends no patience
constexpr std::size_t max_bytes = 1024;    // what Tello clients receive with

sockaddr_in place(std::uint32_t address, std::uint16_t port) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_addr.s_addr = htonl(address);
  out.sin_port = htons(port);
  return out;
}

// Waits a little, or until something comes or a signal asks to end.
void wait(std::initializer_list<int> sockets) {
  std::array<pollfd, 2> polled{};
  std::size_t count = 0;
  for (const int fd : sockets)
    if (fd >= 0) polled[count++] = {fd, POLLIN, 0};
  ::poll(polled.data(), count, static_cast<int>(pace_ns / ns_per_ms));
}

template <typename Take>
void read_all(int fd, Take take) {
  std::array<char, max_bytes> buffer{};
  for (std::size_t i = 0; i < max_reads; ++i) {
    sockaddr_in from{};
    socklen_t size = sizeof from;
    const ssize_t n =
        ::recvfrom(fd, buffer.data(), buffer.size(), MSG_DONTWAIT, reinterpret_cast<sockaddr*>(&from), &size);
    if (n < 0 && errno != ECONNREFUSED) return;
    if (n > 0 && ntohs(from.sin_port) == command_port)
      take(ntohl(from.sin_addr.s_addr), std::string_view(buffer.data(), static_cast<std::size_t>(n)));
  }
}

// What cannot be sent is a lost datagram: the core asks again.
bool say(const link::Descriptor& socket, std::uint32_t address, const std::string& text) {
  const sockaddr_in to = place(address, command_port);
  return ::sendto(socket.get(), text.data(), text.size(), MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&to),
                  sizeof to) >= 0;
}

}  // namespace

Status ask(std::vector<Found>& drones, const std::string& interface) {
  catch_stop_signals();
  auto socket = link::open_udp(interface);
  if (!socket) return socket.error();
  std::size_t next = 0;
  const auto over = [](const Found& drone) { return drone.asking.over(); };
  while (!stop_requested && !std::all_of(drones.begin(), drones.end(), over)) {
    // One datagram a turn, of whoever is due next.
    for (std::size_t i = 0; i < drones.size(); ++i) {
      Found& drone = drones[next++ % drones.size()];
      const std::string text = drone.asking.due(monotonic_ns());
      if (text.empty()) continue;
      (void)say(*socket, drone.address, text);
      break;
    }
    wait({socket->get()});
    read_all(socket->get(), [&](std::uint32_t from, std::string_view bytes) {
      for (Found& drone : drones)
        if (drone.address == from) drone.asking.on_answer(bytes);
    });
  }
  return done;
}

Result<bool> land(std::uint32_t address, const std::string& interface, double seconds) {
  catch_stop_signals();
  auto socket = link::open_udp(interface);
  if (!socket) return socket.error();
  auto states = link::open_udp(interface);
  if (!states) return states.error();
  // Where another client listens already the answers alone must do.
  if (!link::listen_alone(*states, place(INADDR_ANY, state_port)))
    spdlog::info("another program listens to state text here: the drone's answers alone tell when it is down");
  Landing landing;
  bool sent = true;
  for (const TimeNs end = monotonic_ns() + from_seconds(seconds); monotonic_ns() < end && !stop_requested;) {
    for (const std::string& text : landing.due(monotonic_ns())) sent = say(*socket, address, text);
    if (landing.down()) return true;
    wait({socket->get(), states->get()});
    read_all(socket->get(), [&](std::uint32_t from, std::string_view bytes) {
      if (from == address) landing.on_answer(bytes);
    });
    read_all(states->get(), [&](std::uint32_t from, std::string_view bytes) {
      if (from == address) landing.on_state(monotonic_ns(), bytes);
    });
  }
  const std::string where = address_text(address);
  if (!sent) spdlog::error("nothing can be sent to {}: is this computer in the drone's Wi-Fi?", where);
  if (!landing.heard()) {
    spdlog::error(
        "{} does not answer: it was told to land, blindly; a Tello lands by itself 15 s after the last "
        "command",
        where);
  } else {
    spdlog::error("{} answers, but was not seen on the ground{}", where,
                  landing.refusal().empty() ? "" : "; it said: " + landing.refusal());
  }
  return false;
}

Result<std::string> read_password(const std::string& file) {
  if (!file.empty()) {
    auto content = read_file(file);
    if (!content) return content.error();
    return content->substr(0, content->find_first_of("\r\n"));
  }
  termios before{};
  const bool terminal = ::tcgetattr(STDIN_FILENO, &before) == 0;
  if (terminal) {
    termios unseen = before;
    unseen.c_lflag &= ~static_cast<tcflag_t>(ECHO);
    ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &unseen);
    fmt::print(stderr, "Password of that Wi-Fi: ");
  }
  std::string password;
  const bool read = static_cast<bool>(std::getline(std::cin, password));
  if (terminal) {
    ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &before);
    fmt::print(stderr, "\n");
  }
  if (!read) return Error{"no password was given: at the terminal, or with --password-file"};
  return password;
}

}  // namespace ledgerline::tello
