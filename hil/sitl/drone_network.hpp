#pragma once
#include <array>
#include <cstdint>
#include <cstring>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/check.hpp"
#include "common/base/enum_count.hpp"
#include "common/msg/onboard.hpp"
#include "hil/netem/emulated_link.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "onboard/link/core/link_core.hpp"
#include "sim/core/simulator.hpp"

namespace ledgerline::hil {

struct WorldConfig;

/// What goes between the parts: to a drone's port 8889, its answers, its state text, its mocap, agent's plans for it.
enum class DroneTraffic : std::uint8_t { to, answers, states, mocap, plans };
inline constexpr std::size_t drone_traffic_count = enum_count<DroneTraffic>;

/// What mocap says wrongly about a drone.
struct MocapFault {
  bool frozen = false;
  std::array<double, 3> offset_m{};
  std::array<double, 3> creep_mps{};  ///< its frame goes away so fast
  double turn_rad = 0;                ///< of its heading, counter-clockwise
  double noise_m = 0;                 ///< standard deviation
  TimeNs period_ns = 0;
};

/// One drone's emulated links, and the faults in what its sensors report. One thread.
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
  /// The radio of this drone, to it and from it, beside every impairment but another recorded link.
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

// Lengths of iceoryx's queues (onboard/ipc/ipc.cpp), where the oldest goes, and of the agent's ring for mocap, where
// the newest goes; what a socket of 208 kB holds of datagrams of this size.
inline constexpr std::size_t plan_queue = 128, pose_queue = 256, heartbeat_queue = 8, state_queue = 256,
                             transition_queue = 256;
inline constexpr std::size_t mocap_ring = 64, socket_queue = 256;

/// iceoryx's way with a full queue.
template <typename T>
void put(std::deque<T>& queue, const T& value, std::size_t most) {
  if (queue.size() >= most) queue.pop_front();
  queue.push_back(value);
}

template <typename T>
std::vector<T> pop_all(std::deque<T>& queue) {
  std::vector<T> all(queue.begin(), queue.end());
  queue.clear();
  return all;
}

/// A plan as an emulated link carries it.
inline std::string bytes_of(const Plan& plan) { return {reinterpret_cast<const char*>(&plan), sizeof plan}; }

inline Plan plan_of(const std::string& bytes) {
  Plan plan;
  if (!LEDGERLINE_CHECK(bytes.size() == sizeof plan, "a link delivers a plan whole, or not", bytes.size())) return plan;
  std::memcpy(&plan, bytes.data(), sizeof plan);
  return plan;
}

/// What is on its way between two parts.
struct Wires {
  struct Drone {
    DroneNetwork network;
    std::deque<std::pair<TimeNs, std::string>> mocap_ring{};  ///< with the time of arrival
  };
  struct Datagram {
    DroneNumber drone = 0;
    link::Port port = link::Port::answer;
    std::string bytes;
  };
  explicit Wires(const WorldConfig& config);

  std::vector<Drone> drones;
  SdkFaults sdk;  ///< between the drones and their networks
  std::deque<Datagram> to_link;
  std::deque<Plan> plans;
  std::deque<Pose> poses;
  std::deque<AgentHeartbeat> heartbeats;
  std::deque<StateSample> states;
  std::deque<Transition> transitions;
};

}  // namespace ledgerline::hil
