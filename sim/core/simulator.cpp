#include "sim/core/simulator.hpp"

#include <cassert>
#include <deque>

#include "sim/core/firmware/pilot.hpp"
#include "sim/core/firmware/sdk.hpp"
#include "sim/core/sensors.hpp"
#include "sim/core/world.hpp"

namespace ledgerline::sim {
namespace {

struct Drone {
  Drone(const Parameters& parameters, DroneNumber number, Random& seeds)
      : pilot(parameters, seeds.next()), sensors(parameters, seeds.next()), sdk(parameters, number) {}
  Pilot pilot;
  Sensors sensors;
  Sdk sdk;
  bool propeller_lost = false;
  double thrust_by_weight = 0;
};

// What is left when the right front propeller (x forward, y left) is gone: three quarters of the thrust, and its moment
// about the middle, which the flight controller can do nothing about.
Motors three_propellers(const BodyParameters& body, const Motors& four) {
  const double arm_m = body.length_m / 4;
  const double lost_n = four.thrust_n / 4;
  Motors three;
  three.thrust_n = four.thrust_n - lost_n;
  three.torque_nm = {arm_m * lost_n, arm_m * lost_n, 0};
  return three;
}

}  // namespace

struct Simulator::State {
  State(const Parameters& parameters, TimeNs start)
      : p(parameters),
        world(parameters),
        seeds(parameters.seed),
        mocap_noise(seeds.next()),
        now(start),
        next_mocap(start) {
    for (int i = 0; i < p.drones; ++i) {
      Drone& drone = drones.emplace_back(p, static_cast<DroneNumber>(i + 1), seeds);
      drone.sensors.power_on(world.body(i));
      drone.sdk.restart(now);
    }
  }

  Parameters p;
  World world;
  Random seeds, mocap_noise;
  std::deque<Drone> drones;  // neither moved nor copied
  TimeNs now, next_mocap;
  std::vector<Outgoing> pending;
  Output output;

  int index(DroneNumber drone) const {
    assert(drone >= 1 && drone <= p.drones);
    return drone - 1;
  }
  Drone& of(DroneNumber drone) { return drones[static_cast<std::size_t>(index(drone))]; }
  Sdk::Drone parts(int i) {
    Drone& drone = drones[static_cast<std::size_t>(i)];
    return {drone.pilot, drone.sensors, world.body(i)};
  }
  void one_step();
  void measure();
};

Simulator::Simulator(const Parameters& parameters, TimeNs start) : state_(std::make_unique<State>(parameters, start)) {}
Simulator::~Simulator() = default;

void Simulator::datagram(DroneNumber drone, Endpoint from, std::string_view bytes) {
  State& s = *state_;
  s.of(drone).sdk.receive(s.now, from, bytes, s.parts(s.index(drone)), s.pending);
}

void Simulator::State::one_step() {
  now += ns_per_ms;
  for (int i = 0; i < p.drones; ++i) {
    Drone& drone = drones[static_cast<std::size_t>(i)];
    const Motors motors = drone.pilot.step(world.body(i), drone.sensors.sensing());
    drone.thrust_by_weight = motors.thrust_n / (p.body.mass_kg * gravity_mps2);
    world.set_motors(i, drone.propeller_lost ? three_propellers(p.body, motors) : motors);
  }
  world.step();
  for (int i = 0; i < p.drones; ++i) {
    Drone& drone = drones[static_cast<std::size_t>(i)];
    drone.sensors.step({.flying = drone.pilot.phase() != Pilot::Phase::off,
                        .idling = drone.pilot.motors_on(),
                        .thrust_by_weight = drone.thrust_by_weight});
    drone.sdk.step(now, parts(i), output.datagrams);
  }
  if (p.mocap_hz > 0 && now >= next_mocap) {
    next_mocap += from_seconds(1 / p.mocap_hz);
    measure();
  }
}

void Simulator::State::measure() {
  for (int i = 0; i < p.drones; ++i) {
    const Body& body = world.body(i);
    MocapPose pose;
    pose.drone = static_cast<DroneNumber>(i + 1);
    pose.stamp_ns = now;
    for (int axis = 0; axis < 3; ++axis)
      pose.position_m[static_cast<std::size_t>(axis)] = body.position[axis] + p.sensors.mocap_m * mocap_noise.normal();
    Vector turn;
    for (int axis = 0; axis < 3; ++axis) turn[axis] = p.sensors.mocap_rad * mocap_noise.normal() / 2;
    const Rotation q = (Rotation(1, turn.x(), turn.y(), turn.z()) * body.attitude).normalized();
    pose.orientation = {q.x(), q.y(), q.z(), q.w()};
    output.poses.push_back(pose);
  }
}

const Simulator::Output& Simulator::step(TimeNs now) {
  State& s = *state_;
  s.output.datagrams.clear();
  s.output.poses.clear();
  std::swap(s.output.datagrams, s.pending);
  while (s.now + ns_per_ms <= now) s.one_step();
  return s.output;
}

int Simulator::drones() const { return state_->p.drones; }

Truth Simulator::truth(DroneNumber number) const {
  const Drone& drone = state_->of(number);
  const Body& body = state_->world.body(state_->index(number));
  Truth truth;
  for (int axis = 0; axis < 3; ++axis) {
    truth.position_m[static_cast<std::size_t>(axis)] = body.position[axis];
    truth.velocity_mps[static_cast<std::size_t>(axis)] = body.velocity[axis];
  }
  truth.yaw_rad = yaw_of(body.attitude);
  truth.tilt_rad = tilt_of(body.attitude);
  truth.battery = drone.sensors.charge();
  truth.motors_on = drone.pilot.motors_on();
  truth.in_flight = drone.pilot.phase() != Pilot::Phase::off && drone.pilot.phase() != Pilot::Phase::spinning_up;
  truth.crashed = drone.pilot.crashed();
  return truth;
}

void Simulator::kick(DroneNumber drone, const std::array<double, 3>& v) {
  state_->world.kick(state_->index(drone), Vector(v[0], v[1], v[2]));
}

void Simulator::set_battery(DroneNumber drone, double share) { state_->of(drone).sensors.set_battery(share); }

void Simulator::drain_battery(DroneNumber drone, double per_s) { state_->of(drone).sensors.drain(per_s); }

void Simulator::set_temperature(DroneNumber drone, double celsius) {
  state_->of(drone).sensors.set_temperature(celsius);
}

void Simulator::remove_propeller(DroneNumber drone) { state_->of(drone).propeller_lost = true; }

void Simulator::restart(DroneNumber number) {
  Drone& drone = state_->of(number);
  drone.pilot.cut();
  drone.sensors.power_on(state_->world.body(state_->index(number)));
  drone.sdk.restart(state_->now);
}

void Simulator::set_sensing(DroneNumber drone, const Sensing& sensing) {
  state_->of(drone).sensors.set_sensing(sensing);
}

void Simulator::set_wind(const std::array<double, 3>& v) { state_->world.set_wind(Vector(v[0], v[1], v[2])); }

}  // namespace ledgerline::sim
