#pragma once
#include <map>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

#include "sim/core/simulator.hpp"

namespace ledgerline::sim {

/// A state text's fields.
inline std::map<std::string, std::string> fields(const std::string& state) {
  std::map<std::string, std::string> out;
  for (std::size_t at = 0; at < state.size();) {
    const std::size_t end = state.find(';', at);
    if (end == std::string::npos) break;
    const std::string field = state.substr(at, end - at);
    out[field.substr(0, field.find(':'))] = field.substr(field.find(':') + 1);
    at = end + 1;
  }
  return out;
}

inline constexpr double right_angle = std::numbers::pi / 2;

/// A simulator on a simulated clock with one client, as a test wants to talk to it.
class Flight {
 public:
  static constexpr Endpoint client{0x0a000001, 40000};

  explicit Flight(Parameters parameters = calm()) : simulator(parameters, 0) {}

  /// No wind, no noise: for tests of the model itself.
  static Parameters calm() {
    Parameters p;
    p.wind.gust_mps = 0;
    p.sensors = {.mocap_m = 0,
                 .mocap_rad = 0,
                 .tof_m = 0,
                 .baro_m = 0,
                 .accelerometer_g = 0,
                 .attitude_rad = 0,
                 .flow_mps = 0,
                 .flow_scale = 0,
                 .flow_noise_mps = 0,
                 .baro_walk_m = 0,
                 .pad_m = 0,
                 .pad_rad = 0};
    return p;
  }

  void tell(std::string_view text, DroneNumber drone = 1, Endpoint from = client) {
    simulator.datagram(drone, from, text);
  }

  void run(double seconds) {
    const TimeNs end = now + from_seconds(seconds);
    while (now < end) {
      now += ns_per_ms;
      keep(simulator.step(now));
    }
  }

  /// Sends and gives the answer, waiting up to `seconds`; "" when none came.
  std::string ask(std::string_view text, double seconds = 20, DroneNumber drone = 1, Endpoint from = client) {
    answers.clear();
    tell(text, drone, from);
    const TimeNs end = now + from_seconds(seconds);
    keep(simulator.step(now));
    while (now < end && !answer_of(drone)) {
      now += ns_per_ms;
      keep(simulator.step(now));
    }
    const Outgoing* answer = answer_of(drone);
    return answer ? answer->bytes : std::string();
  }

  void take_off(DroneNumber drone = 1) {
    ask("command", 1, drone);
    ask("takeoff", 20, drone);
  }

  /// Of the newest state text.
  std::map<std::string, std::string> state() const { return fields(states.back().bytes); }
  double reported(const std::string& field) const { return std::stod(state().at(field)); }

  Truth truth(DroneNumber drone = 1) const { return simulator.truth(drone); }

  Simulator simulator;
  TimeNs now = 0;
  std::vector<Outgoing> answers;  ///< since the last ask()
  std::vector<Outgoing> states;
  std::vector<MocapPose> poses;
  std::string bytes;  ///< everything that came out, in order

 private:
  void keep(const Simulator::Output& output) {
    for (const Outgoing& datagram : output.datagrams) {
      (datagram.bytes.rfind("mid:", 0) == 0 ? states : answers).push_back(datagram);
      bytes += std::to_string(now) + " " + std::to_string(datagram.drone) + " " + datagram.bytes + "\n";
    }
    for (const MocapPose& pose : output.poses) {
      poses.push_back(pose);
      bytes.append(reinterpret_cast<const char*>(pose.position_m.data()), sizeof pose.position_m);
      bytes.append(reinterpret_cast<const char*>(pose.orientation.data()), sizeof pose.orientation);
    }
  }
  const Outgoing* answer_of(DroneNumber drone) const {
    for (const Outgoing& answer : answers)
      if (answer.drone == drone) return &answer;
    return nullptr;
  }
};

}  // namespace ledgerline::sim
