#pragma once
#include <poll.h>
#include <array>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <vector>

#include "common/base/result.hpp"
#include "hil/netem/emulated_link.hpp"
#include "hil/proxy/settings.hpp"

namespace ledgerline::hil::proxy {

/// Where the drones' state (8890) and video (11111) arrive: one socket each for all drones, distinguished by source
/// address. One thread.
class SharedPorts {
 public:
  static Result<SharedPorts> open(in_addr source);
  SharedPorts(SharedPorts&& other) noexcept;
  SharedPorts& operator=(SharedPorts&&) = delete;
  ~SharedPorts();
  int state() const { return state_; }
  int video() const { return video_; }

 private:
  SharedPorts() = default;
  int state_ = -1, video_ = -1;
};

/// Between the clients of one drone and the drone: four emulated links, to it, and answers, state and video from it.
/// Each client has a socket of its own toward the drone, so that answers find back; state and video go to the client
/// whose `command` went through last, as a Tello does. `port` commands are answered with `error`: state and video would
/// go past the proxy. One thread.
class DroneSide {
 public:
  static constexpr std::size_t max_clients = 8;
  static constexpr TimeNs client_timeout = 10 * ns_per_s;  ///< [ns] one silent for so long gives way to another

  static Result<DroneSide> open(const DroneRoute& route, in_addr source, std::uint64_t seed);
  DroneSide(DroneSide&&) noexcept;
  DroneSide& operator=(DroneSide&&) = delete;
  ~DroneSide();

  const DroneRoute& route() const { return route_; }
  void impair(Direction way, const Impairment& impairment);
  /// What its state text says wrongly from now on.
  void misreport(std::vector<SensorFault> faults) { renew(sensors_, std::move(faults)); }
  /// Adds the sockets that it waits for, sockets() of them.
  void add_to(std::vector<pollfd>& polled) const;
  std::size_t sockets() const { return 1 + clients_.size(); }
  /// Reads its own sockets, at most so many datagrams of each. `polled`: what add_to() added, after poll().
  void receive(TimeNs now, std::span<const pollfd> polled);
  /// State or video that came from its drone.
  void push(Direction way, TimeNs now, std::string_view bytes);
  /// Sends what is due.
  void send(TimeNs now);
  std::optional<TimeNs> next_due() const;
  nlohmann::json summary() const;

 private:
  struct Client {
    sockaddr_in address{};
    int back = -1;     ///< toward the drone
    TimeNs heard = 0;  ///< when it last sent something; monotonic clock [ns]
  };
  DroneSide(const DroneRoute& route, in_addr source, std::uint64_t seed);
  EmulatedLink& link_of(Direction way) { return links_[static_cast<std::size_t>(way)]; }
  Client* client_at(const sockaddr_in& address, TimeNs now);
  void push_from_client(TimeNs now, const sockaddr_in& from, std::string_view bytes);
  void send_to_drone(TimeNs now, const EmulatedLink::Unit& unit);
  void send_to_client(Direction way, const EmulatedLink::Unit& unit);

  DroneRoute route_;
  in_addr source_;
  int lock_ = -1, front_ = -1;
  std::array<EmulatedLink, 4> links_;
  std::vector<SensorFault> sensors_;
  Random noise_;
  std::vector<Client> clients_;
  std::optional<sockaddr_in> commander_;
  std::uint64_t too_many_clients_ = 0, nobody_ = 0, unsent_ = 0, ports_refused_ = 0;
};

/// Reads one socket of all drones and gives each datagram to the side of the drone that sent it; how many came from
/// others.
std::uint64_t receive_shared(int socket, Direction way, TimeNs now, std::span<DroneSide> sides);

nlohmann::json to_json(const EmulatedLinkCounts& counts);

/// Opens everything, prints {"ready":true,"servers":{"NAME":"127.0.0.1:PORT"}} and forwards until SIGINT or SIGTERM,
/// with what the script and the socket switch; then writes the summary. One thread; returns an error where something
/// could not be opened or written.
Status run(const Settings& settings);

}  // namespace ledgerline::hil::proxy
