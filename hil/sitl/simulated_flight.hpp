#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/crypto/crypto.hpp"
#include "common/rt/histogram.hpp"
#include "ground/core/controller.hpp"
#include "hil/sitl/world_setup.hpp"

namespace ledgerline::hil {

/// A world with a perfect network and no faults.
struct SimulatedFlightConfig : WorldConfig {
  SimulatedFlightConfig() {
    laps = 3;
    room_m.reset();
    max_age_ns = 0;  // the defaults, and 5 s with an added delay
  }
  TimeNs max_ns = 600 * ns_per_s;  ///< of simulated time; a flight that is not over by then is not ok
};

struct SimulatedFlightResult {
  bool ok = false;
  std::string why;
  TimeNs flown_ns = 0;      ///< simulated time
  crypto::Digest digest{};  ///< SHA-256 over all blocks, all traces and every datagram to and from the drones
  std::uint64_t blocks = 0, transactions = 0;
  std::uint64_t violations = 0;  ///< integrity violations that agent found
  struct Drone {
    std::string name;
    Quantiles two_way_ms, age_ms;
    double cross_track_rms_m = 0, cross_track_max_m = 0;
    double lowest_m = 0, highest_m = 0;  ///< on its path, by the truth, above the map's zero; 0: it never was on it
    std::vector<double> lap_s;
    /// Each lap by the truth; of a ramp each has its speed.
    struct Lap {
      double asked_mps = 0, flown_mps = 0, seconds = 0, rms_m = 0, max_m = 0;
      double peak_mps = 0;  ///< flown_mps is the mean
    };
    std::vector<Lap> laps;
    double limit_mps = 0;                                   ///< the latency-aware limit at the end; 0: no prediction
    std::optional<double> slowed_to_mps;                    ///< the least limit that was below the speed asked for
    ground::motion::Response response;                      ///< as learned
    std::uint64_t commands_sent = 0, commands_applied = 0;  ///< by ground; by link
  };
  std::vector<Drone> drones;
};

/// A whole flight in a SimulatedWorld, observed: errors, laps, latencies. The same config gives the same digest, on
/// every run.
Result<SimulatedFlightResult> fly_simulated(const SimulatedFlightConfig& config);

}  // namespace ledgerline::hil
