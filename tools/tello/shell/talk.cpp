#include "tools/tello/shell/talk.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>
#include <algorithm>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/program/program.hpp"
#include "onboard/link/shell/transport/udp.hpp"
#include "tools/tello/core/dialogue.hpp"

namespace ledgerline::tello {
Status query(std::vector<Found>& drones, const std::string& interface) {
  catch_stop_signals();
  auto socket = link::open_udp(interface);
  if (!socket) return socket.error();
  std::size_t next = 0;
  const auto over = [](const Found& drone) { return drone.dialogue.over(); };
  while (!stop_requested && !std::all_of(drones.begin(), drones.end(), over)) {
    // One datagram a turn, for the drone that is due next.
    for (std::size_t i = 0; i < drones.size(); ++i) {
      Found& drone = drones[next++ % drones.size()];
      const std::string text = drone.dialogue.pop_due(monotonic_ns());
      if (text.empty()) continue;
      (void)send_text(*socket, drone.address, text);
      break;
    }
    wait({socket->get()});
    read_all(socket->get(), [&](std::uint32_t from, std::string_view bytes) {
      for (Found& drone : drones)
        if (drone.address == from) drone.dialogue.on_answer(bytes);
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
  if (!link::listen_alone(*states, socket_address(INADDR_ANY, state_port)))
    spdlog::info("another program listens to state text here: the drone's answers alone show when it is down");
  Landing landing;
  bool sent = true;
  for (const TimeNs end = monotonic_ns() + from_seconds(seconds); monotonic_ns() < end && !stop_requested;) {
    for (const std::string& text : landing.pop_due(monotonic_ns())) sent = send_text(*socket, address, text);
    if (landing.down()) return true;
    wait({socket->get(), states->get()});
    read_all(socket->get(), [&](std::uint32_t from, std::string_view bytes) {
      if (from == address) landing.on_answer(bytes);
    });
    read_all(states->get(), [&](std::uint32_t from, std::string_view bytes) {
      if (from == address) landing.on_state(monotonic_ns(), bytes);
    });
  }
  const std::string where = ipv4_text(address);
  if (!sent) spdlog::error("nothing can be sent to {}: is this computer in the drone's Wi-Fi?", where);
  if (!landing.has_answered()) {
    spdlog::error(
        "{} does not answer: it was commanded to land without state; a Tello lands by itself 15 s after the last "
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
  auto password = ask_secret("Password of that Wi-Fi");
  if (!password) return Error{"no password was given: at the terminal, or with --password-file"};
  return password;
}

sockaddr_in socket_address(std::uint32_t address, std::uint16_t port) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_addr.s_addr = htonl(address);
  out.sin_port = htons(port);
  return out;
}

void wait(std::initializer_list<int> sockets) {
  std::array<pollfd, 2> polled{};
  std::size_t count = 0;
  for (const int fd : sockets)
    if (fd >= 0) polled[count++] = {fd, POLLIN, 0};
  ::poll(polled.data(), count, static_cast<int>(pace_ns / ns_per_ms));
}

bool send_text(const link::Descriptor& socket, std::uint32_t address, const std::string& text) {
  const sockaddr_in to = socket_address(address, command_port);
  return ::sendto(socket.get(), text.data(), text.size(), MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&to),
                  sizeof to) >= 0;
}

}  // namespace ledgerline::tello
