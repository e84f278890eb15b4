#include "hil/proxy/drone_side.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/log.hpp"
#include "hil/netem/text_parse.hpp"

namespace ledgerline::hil::proxy {
namespace {

constexpr int max_at_once = 64;  // of a socket, so that a flood at one does not hold up the others
constexpr std::size_t max_datagram = 65'536;

sockaddr_in place(in_addr address, std::uint16_t port) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_addr = address;
  out.sin_port = htons(port);
  return out;
}

bool same(const sockaddr_in& a, const sockaddr_in& b) {
  return a.sin_addr.s_addr == b.sin_addr.s_addr && a.sin_port == b.sin_port;
}

std::uint64_t tag_of(const sockaddr_in& address) {
  return std::uint64_t{ntohl(address.sin_addr.s_addr)} << 16 | ntohs(address.sin_port);
}

sockaddr_in from_tag(std::uint64_t tag) {
  in_addr address{};
  address.s_addr = htonl(static_cast<std::uint32_t>(tag >> 16));
  return place(address, static_cast<std::uint16_t>(tag));
}

/// SO_REUSEADDR: a simulator, link and clients of this host hold the same ports at other addresses.
Result<int> bind_udp(const sockaddr_in& address) {
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0) return Error{fmt::format("no UDP socket: {}", std::strerror(errno))};
  const int on = 1;
  if (::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
      ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0)
    return fd;
  const int why = errno;
  ::close(fd);
  return Error{
      fmt::format("cannot listen on UDP {}: {} (a Tello client or another proxy on this host? A client that "
                  "binds 0.0.0.0 without SO_REUSEADDR needs a network namespace of its own)",
                  address_text(address), std::strerror(why))};
}

/// SO_REUSEADDR would let a second proxy in, and each would get a part. Held as long as the descriptor is open.
Result<int> lock_address(const sockaddr_in& address) {
  const int fd = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return Error{fmt::format("no Unix socket: {}", std::strerror(errno))};
  const std::string name = "ledgerline-proxy@" + address_text(address);
  sockaddr_un where{};
  where.sun_family = AF_UNIX;
  std::copy(name.begin(), name.end(), where.sun_path + 1);
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&where), length) == 0) return fd;
  const int why = errno;
  ::close(fd);
  return Error{fmt::format("another proxy holds {} ({}): end it, or choose another address", address_text(address),
                           std::strerror(why))};
}

/// Gives each datagram that is there to `take`, up to a bound.
template <typename Take>
void receive_from(int fd, Take take) {
  std::array<char, max_datagram> buffer;
  for (int i = 0; i < max_at_once; ++i) {
    sockaddr_in from{};
    socklen_t length = sizeof from;
    const ssize_t got =
        ::recvfrom(fd, buffer.data(), buffer.size(), MSG_DONTWAIT, reinterpret_cast<sockaddr*>(&from), &length);
    if (got < 0 && (errno == ECONNREFUSED || errno == EINTR)) continue;  // ICMP about an earlier one: nobody was there
    if (got < 0) return;
    take(from, std::string_view(buffer.data(), static_cast<std::size_t>(got)));
  }
}

}  // namespace

nlohmann::json to_json(const EmulatedLinkCounts& c) {
  return {{"came", c.pushed},           {"went", c.delivered},      {"bytes_in", c.bytes_in},
          {"bytes_out", c.bytes_out},   {"lost", c.lost},           {"no_room", c.no_room},
          {"duplicated", c.duplicated}, {"reordered", c.reordered}, {"corrupted", c.corrupted},
          {"truncated", c.truncated}};
}

Result<SharedPorts> SharedPorts::open(in_addr source) {
  SharedPorts ports;
  const auto state = bind_udp(place(source, state_port));
  if (!state) return state.error();
  ports.state_ = *state;
  const auto video = bind_udp(place(source, video_port));
  if (!video) return video.error();
  ports.video_ = *video;
  return ports;
}

SharedPorts::SharedPorts(SharedPorts&& other) noexcept
    : state_(std::exchange(other.state_, -1)), video_(std::exchange(other.video_, -1)) {}

SharedPorts::~SharedPorts() {
  if (state_ >= 0) ::close(state_);
  if (video_ >= 0) ::close(video_);
}

std::uint64_t receive_shared(int socket, Direction way, TimeNs now, std::span<DroneSide> sides) {
  std::uint64_t outsiders = 0;
  receive_from(socket, [&](const sockaddr_in& from, std::string_view bytes) {
    for (DroneSide& side : sides) {
      if (side.route().address.s_addr == from.sin_addr.s_addr) return side.push(way, now, bytes);
    }
    ++outsiders;
  });
  return outsiders;
}

DroneSide::DroneSide(const DroneRoute& route, in_addr source, std::uint64_t seed)
    : route_(route),
      source_(source),
      links_{EmulatedLink(EmulatedLink::Kind::datagrams, seed), EmulatedLink(EmulatedLink::Kind::datagrams, seed + 1),
             EmulatedLink(EmulatedLink::Kind::datagrams, seed + 2),
             EmulatedLink(EmulatedLink::Kind::datagrams, seed + 3)},
      noise_(seed + 4) {}

Result<DroneSide> DroneSide::open(const DroneRoute& route, in_addr source, std::uint64_t seed) {
  DroneSide side(route, source, seed);
  const sockaddr_in listen = place(route.listen, command_port);
  const auto lock = lock_address(listen);
  if (!lock) return lock.error();
  side.lock_ = *lock;
  const auto front = bind_udp(listen);
  if (!front) return front.error();
  side.front_ = *front;
  return side;
}

DroneSide::DroneSide(DroneSide&& other) noexcept
    : route_(other.route_),
      source_(other.source_),
      lock_(std::exchange(other.lock_, -1)),
      front_(std::exchange(other.front_, -1)),
      links_(std::move(other.links_)),
      noise_(other.noise_),
      clients_(std::exchange(other.clients_, {})) {}

DroneSide::~DroneSide() {
  for (const Client& client : clients_) ::close(client.back);
  if (front_ >= 0) ::close(front_);
  if (lock_ >= 0) ::close(lock_);
}

void DroneSide::impair(Direction way, const Impairment& impairment) {
  if (const auto set = link_of(way).set(impairment); !set) spdlog::error("{}: {}", route_.name, set.error().message);
}

void DroneSide::add_to(std::vector<pollfd>& polled) const {
  polled.push_back({front_, POLLIN, 0});
  for (const Client& client : clients_) polled.push_back({client.back, POLLIN, 0});
}

void DroneSide::receive(TimeNs now, std::span<const pollfd> polled) {
  for (std::size_t i = 0; i < clients_.size(); ++i) {
    if (polled[i + 1].revents == 0) continue;
    receive_from(clients_[i].back, [&](const sockaddr_in& from, std::string_view bytes) {
      const bool from_drone = from.sin_addr.s_addr == route_.address.s_addr;
      if (from_drone) link_of(Direction::answers).push(now, bytes, tag_of(clients_[i].address));
    });
  }
  if (polled[0].revents == 0) return;
  receive_from(front_, [&](const sockaddr_in& from, std::string_view bytes) { push_from_client(now, from, bytes); });
}

void DroneSide::push_from_client(TimeNs now, const sockaddr_in& from, std::string_view bytes) {
  Client* client = client_at(from, now);
  if (!client) return;
  client->heard = now;
  const auto words = words_of(bytes.substr(0, 40));
  if (words.empty() || words[0] != "port") return link_of(Direction::to).push(now, bytes, tag_of(from));
  if (ports_refused_++ == 0)
    spdlog::warn("{}: a client asked for other ports, which the proxy does not do: answered with error", route_.name);
  link_of(Direction::answers).push(now, "error", tag_of(from));
}

void DroneSide::push(Direction way, TimeNs now, std::string_view bytes) {
  std::string said(bytes);
  if (way == Direction::state && !hil::misreport(now, sensors_, noise_, said)) return;
  if (commander_)
    link_of(way).push(now, said, tag_of(*commander_));
  else
    ++nobody_;
}

void DroneSide::send(TimeNs now) {
  while (const auto unit = link_of(Direction::to).pop(now)) send_to_drone(now, *unit);
  for (const Direction way : {Direction::answers, Direction::state, Direction::video}) {
    while (const auto unit = link_of(way).pop(now)) send_to_client(way, *unit);
  }
}

std::optional<TimeNs> DroneSide::next_due() const {
  std::optional<TimeNs> due;
  for (const EmulatedLink& link : links_) due = earlier(due, link.next_due());
  return due;
}

DroneSide::Client* DroneSide::client_at(const sockaddr_in& address, TimeNs now) {
  for (Client& client : clients_) {
    if (same(client.address, address)) return &client;
  }
  if (clients_.size() == max_clients) {
    const auto oldest = std::min_element(clients_.begin(), clients_.end(),
                                         [](const Client& a, const Client& b) { return a.heard < b.heard; });
    if (now - oldest->heard < client_timeout) {
      ++too_many_clients_;
      return nullptr;
    }
    ::close(oldest->back);
    clients_.erase(oldest);
  }
  const auto back = bind_udp(place(source_, 0));
  if (!back) {
    spdlog::error("{}: {}", route_.name, back.error().message);
    ++too_many_clients_;
    return nullptr;
  }
  clients_.push_back({address, *back, now});
  return &clients_.back();
}

void DroneSide::send_to_drone(TimeNs now, const EmulatedLink::Unit& unit) {
  const Client* client = client_at(from_tag(unit.tag), now);
  if (!client) return;
  const auto words = words_of(unit.bytes);
  if (words.size() == 1 && words[0] == "command") commander_ = client->address;
  const sockaddr_in to = place(route_.address, command_port);
  if (::sendto(client->back, unit.bytes.data(), unit.bytes.size(), MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&to),
               sizeof to) < 0)
    ++unsent_;
}

void DroneSide::send_to_client(Direction way, const EmulatedLink::Unit& unit) {
  sockaddr_in to = from_tag(unit.tag);
  if (way == Direction::state) to.sin_port = htons(state_port);
  if (way == Direction::video) to.sin_port = htons(video_port);
  if (::sendto(front_, unit.bytes.data(), unit.bytes.size(), MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&to),
               sizeof to) < 0)
    ++unsent_;
}

nlohmann::json DroneSide::summary() const {
  nlohmann::json out{{"name", route_.name}, {"clients", clients_.size()}, {"too_many_clients", too_many_clients_},
                     {"nobody", nobody_},   {"unsent", unsent_},          {"ports_refused", ports_refused_}};
  for (std::size_t i = 0; i < links_.size(); ++i) {
    nlohmann::json counts = to_json(links_[i].counts());
    counts["waiting"] = links_[i].waiting();
    out[std::string(name_of(Direction{static_cast<int>(i)}))] = std::move(counts);
  }
  return out;
}

}  // namespace ledgerline::hil::proxy
