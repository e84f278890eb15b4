#include "tools/tello/shell/talk.hpp"

#include <poll.h>
#include <sys/socket.h>

namespace ledgerline::tello {

sockaddr_in place(std::uint32_t address, std::uint16_t port) {
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
  const sockaddr_in to = place(address, command_port);
  return ::sendto(socket.get(), text.data(), text.size(), MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&to),
                  sizeof to) >= 0;
}

}  // namespace ledgerline::tello
