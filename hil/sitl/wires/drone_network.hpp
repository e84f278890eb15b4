#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "hil/netem/emulated_link.hpp"
#include "hil/netem/sensor_text.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil {

/// What goes between the parts: to a drone's port 8889, its answers, its state text, its mocap, agent's plans for it.
enum class DroneTraffic : std::uint8_t { to, answers, states, mocap, plans };
inline constexpr std::size_t drone_traffic_count = 5;

/// What mocap says wrongly about a drone.
struct MocapFault {
  bool frozen = false;
  std::array<double, 3> offset_m{};
  std::array<double, 3> creep_mps{};  ///< its frame goes away so fast
  double turn_rad = 0;                ///< of its heading, counter-clockwise
  double noise_m = 0;                 ///< standard deviation
  TimeNs period_ns = 0;
};

/// All emulated links of one drone, and what is said wrongly at their beginning. One thread.
class DroneNetwork {
 public:
  DroneNetwork(Random& seeds, std::uint64_t plans_seed);

  void push(TimeNs now, DroneTraffic at, std::string_view bytes, std::uint64_t tag = 0) {
    link_of(at).push(now, bytes, tag);
  }
  /// A state text, with the sensors' faults in it.
  void push_state(TimeNs now, std::string_view text);
  /// A measurement of mocap with its faults, as a geometry_msgs/PoseStamped. `real_offset_ns`: real time minus `now`.
  void push_mocap(TimeNs now, TimeNs real_offset_ns, const sim::MocapPose& measured);
  /// The next one that is due; call until there is none.
  std::optional<EmulatedLink::Unit> pop(TimeNs now, DroneTraffic at) { return link_of(at).pop(now); }

  void impair(DroneTraffic at, const Impairment& impairment);
  /// The radio of this drone, to it and from it, beside every impairment but another recorded day.
  void set_wifi(const Impairment::RecordedLink& wifi);
  /// All that it has now; one that it had before, by `item`, goes on with what it said and when.
  void set_sensor_faults(std::vector<SensorFault> faults);
  void set_mocap_fault(const MocapFault& fault);

 private:
  EmulatedLink& link_of(DroneTraffic at) { return links_[static_cast<std::size_t>(at)]; }

  std::vector<EmulatedLink> links_;
  std::optional<Impairment::RecordedLink> wifi_;
  std::vector<SensorFault> sensors_;
  MocapFault mocap_;
  std::optional<sim::MocapPose> frozen_at_;
  TimeNs next_mocap_ns_ = 0, creeps_since_ns_ = 0;
  Random noise_{0};
};

}  // namespace ledgerline::hil
