#pragma once
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "hil/netem/sdk/sdk_fault.hpp"
#include "hil/sitl/world.hpp"

namespace ledgerline::hil {

/// What all faults that go on now make of a world together: faults may overlap, so the whole is recomputed whenever one
/// begins or ends. Plain data.
struct Effects {
  struct OfDrone {
    std::array<Impairment, drone_traffic_count> impairments;
    std::vector<SensorFault> sensors;
    std::vector<SdkFault> sdk;
    MocapFault mocap;
    double drain_per_s = 0;
    sim::Sensing sensing;
    Impairment& impairment(DroneTraffic at) { return impairments[static_cast<std::size_t>(at)]; }
    const Impairment& impairment(DroneTraffic at) const { return impairments[static_cast<std::size_t>(at)]; }
  };
  /// A process' connection to the ledger.
  struct OfPort {
    bool cut = false, stale = false, stall_to = false, stall_from = false;
    std::optional<Distribution> delay_to, delay_from;
    Tampering lie = Tampering::none;
    PeerTampering serves = PeerTampering::none, orders = PeerTampering::none;
    Slip slip = Slip::none;
  };
  struct OfRelay {
    RelayTampering lie = RelayTampering::none;
    bool compared = false;  ///< clients compare events before they sign
  };

  explicit Effects(std::size_t drone_count) : drones(drone_count) {}

  std::vector<OfDrone> drones;
  std::array<OfPort, process_count> ports;  ///< by Process; link has none
  std::array<bool, process_count> stopped{};
  std::optional<OfRelay> relay;
  bool ledger_stalled = false;
  std::array<double, 2> clock_drift{};  ///< by SimulatedWorld::Host: so much faster than real time
  std::array<double, 3> wind_mps{};

  OfPort& port(Process process) { return ports[static_cast<std::size_t>(process)]; }
  const OfPort& port(Process process) const { return ports[static_cast<std::size_t>(process)]; }
  void apply_to(SimulatedWorld& world) const;
};

}  // namespace ledgerline::hil
