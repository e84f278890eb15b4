#include "onboard/link/shell/transport/tello_sockets.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <net/if.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <optional>
#include <utility>

#include "onboard/link/core/tello/tello_text.hpp"

namespace ledgerline::link {
namespace {

constexpr TimeNs max_stamp_age_ns = 20 * ns_per_ms;  // a driver that stamps has done so, or the next setpoint is due

Result<Descriptor> open_states(const std::string& interface, const sockaddr_in& listen, std::span<const int> own) {
  auto socket = open_udp(interface);
  if (!socket) return socket.error();
  if (auto status = listen_beside(own, *socket, listen); !status) return status.error();
  return std::move(*socket);
}

}  // namespace

Result<TelloSockets> TelloSockets::create(const ShellSettings& settings) {
  TelloSockets sockets;
  std::optional<Error> missing;
  sockets.state_listen_ = settings.state_listen;
  sockets.state_port_ = settings.state_port;
  sockets.stamps_ = !settings.trace.empty();
  for (std::size_t i = 0; i < settings.link.drones.size(); ++i) {
    Drone drone;
    drone.name = settings.link.drones[i].name;
    drone.number = settings.link.drones[i].number;
    drone.address = settings.addresses[i];
    drone.interface = settings.interfaces[i];
    auto commands = open_udp(drone.interface);
    if (!commands) {
      if (!missing) missing = Error{fmt::format("drone {}: {}", drone.name, commands.error().message)};
      continue;
    }
    drone.commands = std::move(*commands);
    if (sockets.stamps_) (void)stamp_sends(drone.commands);  // a figure that the trace is then without
    drone.reached = connect_to(drone.commands, drone.address);
    const bool open = std::any_of(sockets.states_.begin(), sockets.states_.end(),
                                  [&](const StateText& states) { return states.interface == drone.interface; });
    if (!open) {
      auto socket = open_states(drone.interface, settings.state_listen, sockets.state_fds());
      if (!socket) return Error{fmt::format("drone {}: {}", drone.name, socket.error().message)};
      sockets.states_.push_back({drone.interface, std::move(*socket)});
    }
    sockets.drones_.push_back(std::move(drone));
  }
  if (missing) {
    sockets.send_first_zero();
    return *missing;
  }
  sockets.strange_ports_ = std::make_unique<std::array<std::atomic<std::uint16_t>, max_drones>>();
  sockets.buffers_.resize(max_received);
  return sockets;
}

void TelloSockets::send_first_zero() noexcept {
  for (const Drone& drone : drones_) {
    for (const CommandText& text : {CommandText("command"), rc_text({})}) (void)send({drone.number, text});
  }
}

std::vector<int> TelloSockets::state_fds() const {
  std::vector<int> fds;
  for (const StateText& states : states_) fds.push_back(states.socket.get());
  return fds;
}

std::span<const Received> TelloSockets::receive() noexcept {
  count_ = 0;
  for (std::size_t i = 0; i < drones_.size(); ++i) receive_answers(i);
  for (const StateText& states : states_) receive_states(states);
  return {received_.data(), count_};
}

std::size_t TelloSockets::read(int fd, sockaddr_in& from, bool& more) noexcept {
  socklen_t size = sizeof from;
  auto& buffer = buffers_[count_];
  const ssize_t n =
      ::recvfrom(fd, buffer.data(), buffer.size(), MSG_DONTWAIT, reinterpret_cast<sockaddr*>(&from), &size);
  // A port that nobody listens on answers by ICMP, which shows here as an error of its own: go on reading.
  more = n >= 0 || errno == ECONNREFUSED || errno == EINTR;
  return n < 0 ? 0 : static_cast<std::size_t>(n);
}

// Outsiders' datagrams count as reads too: a flood must not hold the loop, nor one socket starve the others.
void TelloSockets::receive_answers(std::size_t drone) noexcept {
  const std::size_t reads = max_received / 2 / drones_.size();
  bool more = true;
  for (std::size_t i = 0; i < reads && more; ++i) {
    sockaddr_in from{};
    const std::size_t bytes = read(drones_[drone].commands.get(), from, more);
    // Without a way to the drone its socket is not connected, and receives from any sender that finds its port.
    const sockaddr_in& meant = drones_[drone].address;
    if (bytes == 0 || from.sin_addr.s_addr != meant.sin_addr.s_addr || from.sin_port != meant.sin_port) continue;
    received_[count_] = {drones_[drone].number, Port::answer, {buffers_[count_].data(), bytes}};
    ++count_;
  }
}

void TelloSockets::receive_states(const StateText& states) noexcept {
  const std::size_t reads = max_received / 2 / states_.size();
  bool more = true;
  for (std::size_t i = 0; i < reads && more; ++i) {
    sockaddr_in from{};
    const std::size_t bytes = read(states.socket.get(), from, more);
    if (bytes == 0) continue;
    const auto drone =
        std::find_if(drones_.begin(), drones_.end(), [&](const Drone& known) { return is_from(known, states, from); });
    if (drone == drones_.end()) continue;
    received_[count_] = {drone->number, Port::state, {buffers_[count_].data(), bytes}};
    ++count_;
  }
}

bool TelloSockets::is_from(const Drone& drone, const StateText& states, const sockaddr_in& from) noexcept {
  if (from.sin_addr.s_addr != drone.address.sin_addr.s_addr) return false;
  // What has no interface of its own may come through any, also one that other drones are behind.
  if (drone.interface != states.interface && !drone.interface.empty()) return false;
  const std::uint16_t port = ntohs(from.sin_port);
  if (state_port_ == 0 || port == state_port_) return true;
  (*strange_ports_)[static_cast<std::size_t>(&drone - drones_.data())].store(port, std::memory_order_relaxed);
  return false;
}

bool TelloSockets::send(const ToSend& message) noexcept {
  for (Drone& drone : drones_) {
    if (drone.number != message.drone) continue;
    if (stamps_) drone.sent_ns = realtime_ns();
    const std::string_view bytes = message.command.view();
    // A refusal of an earlier datagram (ICMP) comes back in place of this one's sending.
    for (int tries = 0; tries < 2; ++tries) {
      const ssize_t n = ::send(drone.commands.get(), bytes.data(), bytes.size(), MSG_DONTWAIT);
      if (n >= 0 || errno != ECONNREFUSED) return n == static_cast<ssize_t>(bytes.size());
    }
  }
  return false;
}

std::span<const Transport::AtDevice> TelloSockets::at_device() noexcept {
  std::size_t count = 0;
  for (Drone& drone : drones_) {
    if (drone.sent_ns == 0) continue;
    const TimeNs now_ns = realtime_ns();
    const std::optional<TimeNs> at_ns = sent_at(drone.commands, drone.sent_ns);
    if (at_ns) at_device_[count++] = {drone.number, monotonic_ns() - (now_ns - *at_ns)};
    if (at_ns || now_ns > drone.sent_ns + max_stamp_age_ns) drone.sent_ns = 0;
  }
  return {at_device_.data(), count};
}

std::vector<std::string> TelloSockets::refresh() {
  std::vector<std::string> news;
  for (Drone& drone : drones_) refresh(drone, news);
  for (StateText& states : states_) refresh(states, news);
  for (std::size_t i = 0; i < drones_.size(); ++i) {
    const std::uint16_t port = (*strange_ports_)[i].load(std::memory_order_relaxed);
    if (port == 0 || std::exchange(drones_[i].reported_port, true)) continue;
    news.push_back(
        fmt::format("{}: what comes to its state port from port {} of its address is not trusted, but from "
                    "port {} alone ([tello] state_port)",
                    drones_[i].name, port, state_port_));
  }
  return news;
}

void TelloSockets::refresh(Drone& drone, std::vector<std::string>& news) {
  auto probe = open_udp(drone.interface);
  const bool found = probe && connect_to(*probe, drone.address);
  const std::string trouble = !probe ? probe.error().message : found ? "" : "no route leads to " + text(drone.address);
  if (trouble != drone.reported) {
    if (!trouble.empty()) news.push_back(fmt::format("{}: {}; tried again each second", drone.name, trouble));
    drone.reported = trouble;
  }
  const int commands = drone.commands.get();
  if (!found || (drone.reached && same_interface(commands, probe->get()) && same_address(commands, probe->get())))
    return;
  if (stamps_) (void)stamp_sends(*probe);  // a figure that the trace is then without
  const Status replaced = put_in_place_of(commands, std::move(*probe));
  drone.reached = static_cast<bool>(replaced);
  news.push_back(fmt::format("{}: {}", drone.name, replaced ? "there is a new way to it" : replaced.error().message));
}

void TelloSockets::refresh(StateText& states, std::vector<std::string>& news) {
  if (states.interface.empty()) return;
  auto fresh = open_udp(states.interface);
  if (!fresh || same_interface(states.socket.get(), fresh->get())) return;
  auto listening = listen_beside(state_fds(), *fresh, state_listen_);
  if (listening) listening = put_in_place_of(states.socket.get(), std::move(*fresh));
  if (!listening) news.push_back(fmt::format("interface {}: {}", states.interface, listening.error().message));
}

}  // namespace ledgerline::link
