#pragma once
#include <signal.h>

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "common/base/result.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::sim {

/// What carries bytes between the simulated drones and their clients: UDP, or a shim in its place. One thread.
class DroneWire {
 public:
  struct Received {
    DroneNumber drone = 0;
    Endpoint from;
    std::string_view bytes;  ///< until the next receive()
  };
  virtual ~DroneWire() = default;

  /// Waits until something arrives, `until` (CLOCK_MONOTONIC) is reached or a signal comes that `signals_while_waiting`
  /// lets in; false: a signal came.
  virtual bool wait(TimeNs until, const sigset_t& signals_while_waiting) = 0;
  /// The next one that is there already, up to a bound after each wait().
  virtual bool receive(Received& out) = 0;
  /// What cannot go is counted: UDP promises no more.
  virtual void send(const Outgoing& datagram) = 0;
  virtual std::uint64_t unsent() const = 0;
  /// What it adds to the simulator's summary.
  virtual void report_to(nlohmann::json&) const {}
};

/// One UDP socket a drone, each bound to its own address on port 8889: clients distinguish drones by the source address
/// of what they get, so answers and state leave through it. SO_REUSEADDR, so that a client of this host which sets it
/// too can hold 0.0.0.0:8889; a lock on the addresses (an abstract Unix socket of this network namespace) refuses a
/// second simulator, which that option would let in. One thread.
class DroneSockets final : public DroneWire {
 public:
  /// `first_address` in host byte order; the following drones count up.
  static Result<DroneSockets> open(std::uint32_t first_address, int drones);
  DroneSockets(DroneSockets&& other) noexcept;
  DroneSockets& operator=(DroneSockets&&) = delete;
  ~DroneSockets() override;

  bool wait(TimeNs until, const sigset_t& signals_while_waiting) override;
  /// Of each drone, so that a flood at one holds up neither its neighbours nor the simulation. The rest stays in the
  /// kernel's queue, which drops what is too much.
  static constexpr int max_at_once = 64;
  bool receive(Received& out) override;
  /// What cannot go is logged, too, once a drone.
  void send(const Outgoing& datagram) override;
  std::uint64_t unsent() const override { return unsent_; }

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
