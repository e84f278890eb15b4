#pragma once
#include <poll.h>

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <vector>

#include "hil/netem/emulated_link.hpp"
#include "hil/proxy/settings.hpp"

namespace ledgerline::hil::proxy {

/// Between the clients of one server and the server (TCP): two emulated links a connection. While a direction is
/// partitioned no connection is taken up: it waits, as it would for a lost SYN. One that is reset on one side is reset
/// on the other. One thread.
class ServerSide {
 public:
  static constexpr std::size_t max_connections = 64;       ///< beyond them a new one is reset
  static constexpr TimeNs accept_pause = 100 * ns_per_ms;  ///< when this process may open no more files

  static Result<ServerSide> open(const ServerRoute& route, std::uint64_t seed);
  ServerSide(ServerSide&&) noexcept;
  ServerSide& operator=(ServerSide&&) = delete;
  ~ServerSide();

  const ServerRoute& route() const { return route_; }
  /// Where it really listens.
  const sockaddr_in& listening() const { return listening_; }
  void impair(Direction way, const Impairment& impairment);
  /// Resets every connection.
  void cut();
  /// Adds the sockets that it waits for, sockets() of them.
  void add_to(TimeNs now, std::vector<pollfd>& polled) const;
  std::size_t sockets() const { return 1 + 2 * connections_.size(); }
  /// Takes connections, reads and writes, what is possible and due. `polled`: what add_to() added, after poll().
  void serve(TimeNs now, std::span<const pollfd> polled);
  /// When there is something to do though no socket says so.
  std::optional<TimeNs> next_due(TimeNs now) const;
  nlohmann::json summary() const;

 private:
  struct Half;
  struct Connection;
  ServerSide(const ServerRoute& route, std::uint64_t seed);
  bool may_accept(TimeNs now) const;
  void accept_all(TimeNs now);
  void close(Connection& connection, bool reset);
  void add_counts(const Connection& connection);

  ServerRoute route_;
  std::uint64_t seed_;
  sockaddr_in listening_{};
  int listener_ = -1;
  Impairment to_, from_;
  std::vector<std::unique_ptr<Connection>> connections_;
  EmulatedLinkCounts to_counts_, from_counts_;  ///< of connections that ended
  std::uint64_t taken_ = 0, too_many_ = 0, unreached_ = 0, resets_ = 0, cut_ = 0, not_taken_ = 0;
  TimeNs accept_from_ = 0, first_reset_ = 0;
};

}  // namespace ledgerline::hil::proxy
