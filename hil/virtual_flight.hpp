#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/rt/histogram.hpp"
#include "ground/core/path.hpp"
#include "hil/virtual_ledger.hpp"

namespace ledgerline::hil {

struct VirtualFlightConfig {
  int drones = 1;
  ground::Shape shape = ground::Shape::square;
  double speed_mps = 0.5;
  double rate_hz = 30;
  int laps = 3;
  std::size_t batch_count = 1;
  TimeNs batch_timeout_ns = 10 * ns_per_ms;
  LedgerDelays delays;
  std::uint64_t seed = 1;
  TimeNs longest_ns = 600 * ns_per_s;  ///< of virtual time; a flight that is not over by then is not ok
};

struct VirtualFlightResult {
  bool ok = false;
  std::string why;
  TimeNs flown_ns = 0;      ///< virtual time
  crypto::Digest digest{};  ///< SHA-256 over all blocks, all traces and every datagram to and from the drones
  std::uint64_t blocks = 0, transactions = 0;
  struct Drone {
    std::string name;
    Quantiles two_way_ms, age_ms;
    double cross_track_rms_m = 0, cross_track_max_m = 0;
    std::vector<double> lap_s;
    std::uint64_t commands_sent = 0, commands_applied = 0;  ///< by ground; by link
  };
  std::vector<Drone> drones;
};

/// A whole flight in one thread: the cores of sim, link, agent, node and ground on a virtual clock of 1 ms steps, with
/// test signers; UDP, shared memory, DDS and gRPC are left out, their bytes are not. The same config gives the same
/// digest, on every run.
Result<VirtualFlightResult> fly_virtually(const VirtualFlightConfig& config);

}  // namespace ledgerline::hil
