#pragma once
#include <array>
#include <cmath>
#include <deque>
#include <numbers>
#include <string>
#include <utility>

#include "onboard/link/core/tello/tello_text.hpp"
#include "sim/core/simulator.hpp"
#include "tools/tello/core/calibrate/estimate.hpp"
#include "tools/tello/core/calibrate/flight.hpp"

namespace ledgerline::tello {

/// A simulated drone, and a way to it that may be longer than nothing and turn signs around.
struct Drone {
  sim::Parameters parameters;
  TimeNs delay_ns = 0;                      ///< of each datagram to the drone
  std::array<int, 4> rc_signs{1, 1, 1, 1};  ///< what its firmware makes of a, b, c, d
  std::array<int, 3> vg_signs{1, 1, 1};
  bool vg_in_body = false;
  double mount_rad = 0;  ///< of the nose in the pose's frame
};

/// A calibration flight against sim's core, on a simulated clock.
class World {
 public:
  World(const Drone& drone, const CalibrationSettings& settings)
      : drone_(drone), poses_(settings.poses), simulator_(drone.parameters, 0), flight(settings) {}

  /// Until it is over, or `seconds` are.
  void fly(double seconds = 400) {
    for (const TimeNs end = now + from_seconds(seconds); now < end && !flight.over();) step();
  }
  void step() {
    now += 2 * ns_per_ms;
    for (const std::string& word : flight.pop_due(now)) {
      last_word = word;
      if (reaches_drone) way_.emplace_back(now + drone_.delay_ns, as_obeyed(word));
    }
    for (; !way_.empty() && way_.front().first <= now; way_.pop_front())
      simulator_.datagram(1, {1, 40000}, way_.front().second);
    const auto& out = simulator_.step(now);
    for (const sim::Outgoing& datagram : out.datagrams) {
      if (!heard) continue;
      if (datagram.bytes.rfind("mid:", 0) == 0)
        flight.on_state(now, as_reported(datagram.bytes));
      else
        flight.on_answer(datagram.bytes);
    }
    for (const sim::MocapPose& pose : out.poses)
      if (poses_ && seen) flight.on_pose(as_posed(pose));
  }
  sim::Truth truth() const { return simulator_.truth(1); }

  TimeNs now = 0;
  bool heard = true, seen = true, reaches_drone = true;
  std::string last_word;

 private:
  std::string as_obeyed(const std::string& word) const {
    link::Rc rc{};
    if (std::sscanf(word.c_str(), "rc %d %d %d %d", &rc[0], &rc[1], &rc[2], &rc[3]) != 4) return word;
    for (std::size_t i = 0; i < 4; ++i) rc[i] *= drone_.rc_signs[i];
    return std::string(link::rc_text(rc).view());
  }
  std::string as_reported(const std::string& text) const {
    link::TelloState state;
    link::parse_state(text, state);
    double x = state.velocity_dmps[0], y = state.velocity_dmps[1];
    const double ccw = -state.attitude_deg[2] * std::numbers::pi / 180;
    if (drone_.vg_in_body) {
      const double c = std::cos(ccw), s = std::sin(ccw);
      std::tie(x, y) = std::pair(std::round(c * x + s * y), std::round(-s * x + c * y));
    }
    std::string out = text;
    const double values[] = {x, y, static_cast<double>(state.velocity_dmps[2])};
    const char* const keys[] = {"vgx:", "vgy:", "vgz:"};
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t at = out.find(keys[i]) + 4;
      out.replace(at, out.find(';', at) - at, std::to_string(static_cast<int>(values[i]) * drone_.vg_signs[i]));
    }
    return out;
  }
  PoseSample as_posed(const sim::MocapPose& pose) const {
    const auto& q = pose.orientation;
    const double yaw = std::atan2(2 * (q[3] * q[2] + q[0] * q[1]), 1 - 2 * (q[1] * q[1] + q[2] * q[2]));
    return {pose.stamp_ns, pose.position_m, std::remainder(yaw - drone_.mount_rad, 2 * std::numbers::pi)};
  }

  Drone drone_;
  bool poses_;
  sim::Simulator simulator_;
  std::deque<std::pair<TimeNs, std::string>> way_;

 public:
  CalibrationFlight flight;
};

/// Five drones that differ in all that is measured.
inline std::array<Drone, 5> five_drones() {
  std::array<Drone, 5> drones;
  const double full[] = {0.7, 0.9, 1.0, 1.2, 1.5}, lag[] = {0.2, 0.25, 0.3, 0.4, 0.5};
  const double yaw[] = {0, 1.0, -2.5, 3.1, -0.6}, rate[] = {100, 80, 120, 90, 110}, mount[] = {0, 0.1, -1.6, 2.0, 0.02};
  const int delay_ms[] = {20, 120, 60, 40, 80};
  for (std::size_t i = 0; i < 5; ++i) {
    Drone& d = drones[i];
    d.parameters.seed = 11 + i;
    d.parameters.sdk.rc_full_mps = full[i];
    d.parameters.sdk.rc_full_yaw_degps = rate[i];
    d.parameters.control.velocity_lag_s = lag[i];
    d.parameters.start_yaw_rad = yaw[i];
    d.delay_ns = delay_ms[i] * ns_per_ms;
    d.mount_rad = mount[i];
  }
  drones[1].rc_signs = {-1, 1, 1, -1};
  drones[2].rc_signs = {1, -1, 1, 1};
  drones[3].rc_signs = {-1, -1, -1, -1};
  drones[1].vg_signs = {-1, 1, -1};
  drones[2].vg_signs = {1, -1, -1};
  drones[3].vg_signs = {-1, -1, 1};
  drones[2].vg_in_body = drones[3].vg_in_body = true;
  return drones;
}

}  // namespace ledgerline::tello
