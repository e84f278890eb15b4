#pragma once
#include <signal.h>

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::sim {

/// One UDP socket a drone, each bound to its own address on port 8889: clients tell drones apart by the source address
/// of what they get, so answers and state leave through it. SO_REUSEADDR, so that a client of this host which sets it
/// too can hold 0.0.0.0:8889; a lock on the addresses (an abstract Unix socket of this network namespace) refuses a
/// second simulator, which that option would let in. One thread.
class DroneSockets {
 public:
  /// `first_address` in host byte order; the following drones count up.
  static Result<DroneSockets> open(std::uint32_t first_address, int drones);
  DroneSockets(DroneSockets&& other) noexcept;
  DroneSockets& operator=(DroneSockets&&) = delete;
  ~DroneSockets();

  struct Received {
    DroneNumber drone = 0;
    Endpoint from;
    std::string_view bytes;  ///< until the next receive()
  };
  /// Waits until something arrives, `until` (CLOCK_MONOTONIC) is reached or a signal comes that `signals_while_waiting`
  /// lets in; false: a signal came.
  bool wait(TimeNs until, const sigset_t& signals_while_waiting);
  /// The next datagram that is there already; at most max_at_once of each drone after a wait(), so that a flood at one
  /// holds up neither its neighbours nor the simulation. The rest stays in the kernel's queue, which drops what is too
  /// much.
  static constexpr int max_at_once = 64;
  bool receive(Received& out);
  /// A datagram that cannot go is counted and logged (once a drone): UDP promises no more.
  void send(const Outgoing& datagram);
  std::uint64_t unsent() const { return unsent_; }

 private:
  DroneSockets() = default;
  std::vector<int> sockets_;
  std::vector<int> locks_;
  std::vector<bool> warned_;
  std::size_t next_ = 0;
  int taken_ = 0;  // of the next one, since the last wait
  std::array<char, 2048> buffer_{};
  std::uint64_t unsent_ = 0;
};

}  // namespace ledgerline::sim
