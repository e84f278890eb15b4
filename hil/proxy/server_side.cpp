#include "hil/proxy/server_side.hpp"

#include <fmt/format.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/log.hpp"
#include "hil/proxy/drone_side.hpp"

namespace ledgerline::hil::proxy {
namespace {

constexpr std::size_t max_read = 16'384;       // of a connection in a turn
constexpr TimeNs room_period = 1 * ns_per_ms;  // how often a link that takes nothing more is asked again
constexpr int waiting_connections = 64;

void no_delay(int fd) {
  const int on = 1;
  ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

void close_socket(int fd, bool reset) {
  const linger at_once{1, 0};  // a reset, not an end
  if (reset) ::setsockopt(fd, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  ::close(fd);
}

bool would_block() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

void add(EmulatedLinkCounts& sum, const EmulatedLinkCounts& more) {
  sum.pushed += more.pushed;
  sum.delivered += more.delivered;
  sum.bytes_in += more.bytes_in;
  sum.bytes_out += more.bytes_out;
}

}  // namespace

/// One direction of a connection.
struct ServerSide::Half {
  EmulatedLink link;
  int source, sink;
  std::string pending = {};  ///< due, and not yet taken by the sink; at most one unit
  bool end_read = false, end_due = false, end_sent = false;

  bool may_read(TimeNs now) const { return !end_read && link.room(now) > 0; }

  /// False: the source was reset.
  bool read(TimeNs now) {
    std::array<char, max_read> buffer;
    const std::size_t room = std::min(buffer.size(), link.room(now));
    if (end_read || room == 0) return true;
    const ssize_t got = ::recv(source, buffer.data(), room, MSG_DONTWAIT);
    if (got < 0) return would_block();
    end_read = got == 0;
    link.push(now, {buffer.data(), static_cast<std::size_t>(got)});
    return true;
  }

  /// False: the sink was reset.
  bool write(TimeNs now) {
    for (;;) {
      while (!pending.empty()) {
        const ssize_t sent = ::send(sink, pending.data(), pending.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
        if (sent < 0) return would_block();
        pending.erase(0, static_cast<std::size_t>(sent));
      }
      if (end_due && !std::exchange(end_sent, true)) ::shutdown(sink, SHUT_WR);
      auto unit = link.pop(now);
      if (!unit) return true;
      end_due = unit->bytes.empty();
      pending = std::move(unit->bytes);
    }
  }
};

struct ServerSide::Connection {
  int client, server;
  bool reached = false;  ///< the server
  Half to, from;
};

ServerSide::ServerSide(const ServerRoute& route, std::uint64_t seed) : route_(route), seed_(seed) {}

Result<ServerSide> ServerSide::open(const ServerRoute& route, std::uint64_t seed) {
  ServerSide side(route, seed);
  side.listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const int on = 1;  // ports of connections that have just ended
  if (side.listener_ >= 0) ::setsockopt(side.listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  socklen_t size = sizeof side.listening_;
  if (side.listener_ < 0 ||
      ::bind(side.listener_, reinterpret_cast<const sockaddr*>(&route.listen), sizeof route.listen) != 0 ||
      ::listen(side.listener_, waiting_connections) != 0 ||
      ::getsockname(side.listener_, reinterpret_cast<sockaddr*>(&side.listening_), &size) != 0)
    return Error{
        fmt::format("{}: cannot listen on TCP {}: {}", route.name, address_text(route.listen), std::strerror(errno))};
  return side;
}

ServerSide::ServerSide(ServerSide&& other) noexcept
    : route_(other.route_),
      seed_(other.seed_),
      listening_(other.listening_),
      listener_(std::exchange(other.listener_, -1)),
      to_(other.to_),
      from_(other.from_),
      connections_(std::exchange(other.connections_, {})) {}

ServerSide::~ServerSide() {
  for (const auto& connection : connections_) {
    ::close(connection->client);
    ::close(connection->server);
  }
  if (listener_ >= 0) ::close(listener_);
}

void ServerSide::impair(Direction way, const Impairment& impairment) {
  (way == Direction::to ? to_ : from_) = impairment;
  for (const auto& connection : connections_) {
    const auto set = (way == Direction::to ? connection->to : connection->from).link.set(impairment);
    if (!set) spdlog::error("{}: {}", route_.name, set.error().message);
  }
}

void ServerSide::cut() {
  cut_ += connections_.size();
  for (const auto& connection : connections_) close(*connection, true);
  connections_.clear();
}

bool ServerSide::may_accept(TimeNs now) const { return !to_.partition && !from_.partition && now >= accept_from_; }

void ServerSide::add_to(TimeNs now, std::vector<pollfd>& polled) const {
  const auto wanted = [&](int fd, const Half& reads, const Half& writes) -> pollfd {
    const int events = (reads.may_read(now) ? POLLIN : 0) | (writes.pending.empty() ? 0 : POLLOUT);
    return {events == 0 ? -1 : fd, static_cast<short>(events), 0};  // its end would be reported repeatedly
  };
  polled.push_back({may_accept(now) ? listener_ : -1, POLLIN, 0});
  for (const auto& c : connections_) {
    if (c->reached) {
      polled.push_back(wanted(c->client, c->to, c->from));
      polled.push_back(wanted(c->server, c->from, c->to));
    } else {
      polled.push_back({-1, 0, 0});
      polled.push_back({c->server, POLLOUT, 0});
    }
  }
}

void ServerSide::serve(TimeNs now, std::span<const pollfd> polled) {
  for (std::size_t i = 0; i < connections_.size(); ++i) {
    Connection& c = *connections_[i];
    const pollfd& client = polled[1 + 2 * i];
    const pollfd& server = polled[2 + 2 * i];
    if (!c.reached) {
      if (server.revents == 0) continue;
      int error = 0;
      socklen_t size = sizeof error;
      ::getsockopt(c.server, SOL_SOCKET, SO_ERROR, &error, &size);
      c.reached = error == 0;
      if (!c.reached) {
        ++unreached_;
        close(c, true);
        continue;
      }
    }
    const bool good = (client.revents == 0 || c.to.read(now)) && (server.revents == 0 || c.from.read(now)) &&
                      c.to.write(now) && c.from.write(now);
    if (!good && resets_++ == 0) first_reset_ = now;
    if (!good || (c.to.end_sent && c.from.end_sent)) close(c, !good);
  }
  std::erase_if(connections_, [](const auto& c) { return c->client < 0; });
  if (polled[0].revents != 0) accept_all(now);
}

void ServerSide::accept_all(TimeNs now) {
  for (;;) {
    const int client = ::accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (client < 0 && !would_block() && errno != ECONNABORTED) {  // it stays readable
      accept_from_ = now + accept_pause;
      if (not_taken_++ == 0)
        spdlog::warn("{}: no connection can be taken for now: {}", route_.name, std::strerror(errno));
    }
    if (client < 0) return;
    const int server =
        connections_.size() < max_connections ? ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0) : -1;
    if (server < 0) {
      ++too_many_;
      close_socket(client, true);
      continue;
    }
    no_delay(client);
    no_delay(server);
    const std::uint64_t seed = seed_ + 2 * ++taken_;
    using Kind = EmulatedLink::Kind;
    connections_.push_back(
        std::make_unique<Connection>(Connection{client,
                                                server,
                                                false,
                                                {EmulatedLink(Kind::stream, seed), client, server},
                                                {EmulatedLink(Kind::stream, seed + 1), server, client}}));
    impair(Direction::to, to_);
    impair(Direction::from, from_);
    // The socket reports what becomes of it.
    if (::connect(server, reinterpret_cast<const sockaddr*>(&route_.address), sizeof route_.address) == 0 ||
        errno == EINPROGRESS)
      continue;
    ++unreached_;
    close(*connections_.back(), true);
    connections_.pop_back();
  }
}

std::optional<TimeNs> ServerSide::next_due(TimeNs now) const {
  std::optional<TimeNs> least;
  if (now < accept_from_) least = accept_from_;
  const auto consider = [&](const Half& half) {
    auto due = half.pending.empty() ? half.link.next_due() : std::nullopt;
    if (!half.end_read && half.link.room(now) == 0) due = earlier(due, now + room_period);
    least = earlier(least, due);
  };
  for (const auto& connection : connections_) {
    if (!connection->reached) continue;
    consider(connection->to);
    consider(connection->from);
  }
  return least;
}

void ServerSide::close(Connection& connection, bool reset) {
  add_counts(connection);
  close_socket(std::exchange(connection.client, -1), reset);
  close_socket(std::exchange(connection.server, -1), reset);
}

void ServerSide::add_counts(const Connection& connection) {
  add(to_counts_, connection.to.link.counts());
  add(from_counts_, connection.from.link.counts());
}

nlohmann::json ServerSide::summary() const {
  EmulatedLinkCounts to = to_counts_, from = from_counts_;
  for (const auto& connection : connections_) {
    add(to, connection->to.link.counts());
    add(from, connection->from.link.counts());
  }
  const auto counts = [](const EmulatedLinkCounts& c) {
    return nlohmann::json{{"bytes_in", c.bytes_in}, {"bytes_out", c.bytes_out}};
  };
  return {{"name", route_.name},
          {"connections", taken_},
          {"open", connections_.size()},
          {"too_many", too_many_},
          {"unreached", unreached_},
          {"resets", resets_},
          {"first_reset_ns", first_reset_},
          {"cut", cut_},
          {"not_taken", not_taken_},
          {"to", counts(to)},
          {"from", counts(from)}};
}

}  // namespace ledgerline::hil::proxy
