#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/msg/onboard.hpp"
#include "common/rt/clock.hpp"
#include "sim/core/parameters.hpp"

namespace ledgerline::sim {

/// An IPv4 address in host byte order and a UDP port. On a simulated clock any numbers serve, as long as they
/// distinguish clients.
struct Endpoint {
  std::uint32_t address = 0;
  std::uint16_t port = 0;
  auto operator<=>(const Endpoint&) const = default;
};

/// What a drone sends: an answer (to the address and port that the command came from) or state (to port 8890 of the
/// client that said `command` last). Always from the drone's own address, port 8889.
struct Outgoing {
  DroneNumber drone = 0;
  Endpoint to;
  std::string bytes;
};

/// One measurement of the motion capture system, noise included; map frame, yaw counter-clockwise from x.
struct MocapPose {
  DroneNumber drone = 0;
  TimeNs stamp_ns = 0;
  std::array<double, 3> position_m{};
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< x, y, z, w
};

/// Where a drone really is.
struct Truth {
  std::array<double, 3> position_m{};  ///< of the drone's underside: z is 0 on the ground
  std::array<double, 3> velocity_mps{};
  double yaw_rad = 0;
  double tilt_rad = 0;
  double battery = 0;  ///< 0..1
  bool motors_on = false;
  bool in_flight = false;  ///< from lift-off until the motors stop
  bool crashed = false;    ///< turned over; takeoff is refused until it stands upright again
};

/// N simulated Tellos in one world, all of it a core: no clock, thread, socket or randomness but the seed. Same
/// parameters and same calls give the same bytes. Drone k (from 1) starts at ((k-1) % columns, (k-1) / columns) *
/// spacing, and looks to start_yaw_rad.
///
/// Physics runs in steps of 1 ms: step(now) runs all steps that are due since the last call. Answers to datagrams come
/// out of the next step() call, which may well be at the same `now`. One instance belongs to one thread.
///
/// Not simulated yet: VIDEO. `streamon` and `streamoff` answer ok, but no picture is sent to port 11111, so
/// djitellopy's get_frame_read() fails after its 5 s.
class Simulator {
 public:
  Simulator(const Parameters& parameters, TimeNs start);
  ~Simulator();
  Simulator(const Simulator&) = delete;
  Simulator& operator=(const Simulator&) = delete;

  /// What came out since the last step: valid until the next.
  struct Output {
    std::vector<Outgoing> datagrams;
    std::vector<MocapPose> poses;
  };

  /// Bytes that arrived at port 8889 of a drone.
  void datagram(DroneNumber drone, Endpoint from, std::string_view bytes);
  const Output& step(TimeNs now);

  int drones() const;
  Truth truth(DroneNumber drone) const;
  /// A push from outside, as a velocity in the map frame added at once; for tests and fault scripts.
  void kick(DroneNumber drone, const std::array<double, 3>& velocity_mps);
  /// What breaks, for fault scripts. A battery holds `share` (0..1) now, and loses `per_s` of the whole a second beside
  /// what flying takes.
  void set_battery(DroneNumber drone, double share);
  void drain_battery(DroneNumber drone, double per_s);
  /// It is so hot now: above HeatParameters::shutdown_c it lands and switches itself off.
  void set_temperature(DroneNumber drone, double celsius);
  /// The right front propeller comes off: a quarter of the thrust is gone there, and nothing holds the balance.
  void remove_propeller(DroneNumber drone);
  /// Off and on again: the motors stop, and it waits for `command` as after switching on.
  void restart(DroneNumber drone);
  /// Light, floor, and faults of its sensors from now on.
  void set_sensing(DroneNumber drone, const Sensing& sensing);
  /// Wind of this velocity, map frame, beside the gusts; for all drones.
  void set_wind(const std::array<double, 3>& velocity_mps);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace ledgerline::sim
