#pragma once
#include <signal.h>

#include <cstdint>
#include <string_view>

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
};

}  // namespace ledgerline::sim
