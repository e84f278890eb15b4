#pragma once
#include <cassert>
#include <cstring>
#include <deque>
#include <string>
#include <utility>
#include <vector>

#include "common/msg/onboard.hpp"
#include "hil/netem/sdk/sdk_faults.hpp"
#include "hil/sitl/wires/drone_network.hpp"
#include "onboard/link/core/link_core.hpp"

namespace ledgerline::hil {

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
std::vector<T> take(std::deque<T>& queue) {
  std::vector<T> all(queue.begin(), queue.end());
  queue.clear();
  return all;
}

/// A plan as an emulated link carries it.
inline std::string bytes_of(const Plan& plan) { return {reinterpret_cast<const char*>(&plan), sizeof plan}; }

inline Plan plan_of(const std::string& bytes) {
  Plan plan;
  assert(bytes.size() == sizeof plan);
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
  Wires(std::uint64_t seed, std::size_t drone_count) : sdk(seed, drone_count) {}

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
