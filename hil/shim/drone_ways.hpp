#pragma once
#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hil/netem/emulated_link.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/netem/sensor_text.hpp"
#include "hil/proxy/switches.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil::shim {

/// What lies between clients and simulated drones, without a network: for each drone three emulated links (to it, its
/// answers, its state text), what its state text says wrongly, and what goes wrong at its SDK. A core; the same seed,
/// switches and calls give the same bytes. One thread; `now` never goes back.
class DroneWays {
 public:
  DroneWays(int drones, std::uint64_t seed);

  /// The drones as targets of switches: tello1, tello2, ... No video: the simulator sends none.
  static std::vector<proxy::Target> targets(int drones);
  /// From now on; of Switches over targets().
  void set(const proxy::Switches& switches);

  /// What a client said to a drone; a drone that there is not is nobody's.
  void from_client(TimeNs now, DroneNumber drone, sim::Endpoint client, std::string_view bytes);
  /// What a drone sends to its client: an answer, or state text (to port 8890).
  void from_drone(TimeNs now, const sim::Outgoing& datagram);

  struct ToDrone {
    DroneNumber drone = 0;
    sim::Endpoint from;
    std::string bytes;
  };
  /// What is due; call until there is none.
  std::optional<ToDrone> to_drone(TimeNs now);
  std::optional<sim::Outgoing> to_client(TimeNs now);
  const SdkFaults::Counts& sdk_counts() const { return sdk_.counts(); }
  /// When one of the two will give something; none: not before something comes or is switched.
  std::optional<TimeNs> next_due() const;

 private:
  enum class Way : std::uint8_t { to, answers, state };
  static constexpr std::size_t way_count = 3;
  struct Drone {
    std::array<EmulatedLink, way_count> links;
    std::vector<SensorFault> sensors;
    Random noise;
    sim::Endpoint client;    ///< that said the newest command: answers of the SDK's faults go there
    sim::Endpoint listener;  ///< where its state text goes
    EmulatedLink& link_of(Way way) { return links[static_cast<std::size_t>(way)]; }
  };
  void push_due(TimeNs now);
  std::vector<Drone> drones_;
  SdkFaults sdk_;
};

}  // namespace ledgerline::hil::shim
