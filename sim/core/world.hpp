#pragma once
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <memory>

#include "common/base/random.hpp"
#include "sim/core/parameters.hpp"

namespace ledgerline::sim {

using Vector = Eigen::Vector3d;
using Rotation = Eigen::Quaterniond;

inline constexpr double step_s = 0.001;
inline constexpr double gravity_mps2 = 9.80665;

/// One drone's body. Map frame (x east, y north, z up); the body's own axes are x forward, y left, z up.
struct Body {
  Vector position = Vector::Zero();          ///< of the underside's middle: z is 0 on the ground [m]
  Vector velocity = Vector::Zero();          ///< map frame [m/s]
  Rotation attitude = Rotation::Identity();  ///< body to map
  Vector rates = Vector::Zero();             ///< angular velocity, body axes [rad/s]
  Vector specific_force = Vector::Zero();    ///< what an accelerometer feels, body axes [m/s2]
  bool touching = false;                     ///< ground or another drone
};

/// What the motors make together.
struct Motors {
  double thrust_n = 0;                ///< along the body's z
  Vector torque_nm = Vector::Zero();  ///< body axes
};

/// Bodies, air and ground: ODE. Deterministic: dWorldStep (no random numbers of ODE), drones in order of number.
/// Drones are counted from 0 here. One thread.
class World {
 public:
  explicit World(const Parameters& parameters);
  ~World();
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  int size() const;
  /// Holds until it is changed; thrust follows with the motors' lag.
  void set_motors(int drone, const Motors& motors);
  /// One step of 1 ms.
  void step();
  const Body& body(int drone) const;
  Vector wind(int drone) const;
  void kick(int drone, const Vector& velocity);
  /// A steady wind beside the gusts; map frame.
  void set_wind(const Vector& velocity);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// From here on pure: angles, and what the rotors' air does, the jet below a drone and the cushion above the ground.

/// Counter-clockwise from the map's x.
double yaw_of(const Rotation& attitude);
/// Angle between the body's z and the map's.
double tilt_of(const Rotation& attitude);

/// The jet's velocity at a point, from a drone whose rotors make `thrust_n`; map frame. Along the drone's own axis it
/// keeps its speed for a core's length, then widens and slows so that its momentum stays the same.
Vector downwash(const Parameters& parameters, const Body& above, double thrust_n, const Vector& at);

/// By how much the rotors pull more near the ground than they would far above it: 1 to 1.25.
double ground_effect(const Parameters& parameters, double height_m);

/// What becomes of four rotors' thrust in air that comes from above: together, and about the body's x and y.
struct RotorLoss {
  double thrust_n = 0;
  Vector torque_nm = Vector::Zero();  ///< body axes
  Vector air = Vector::Zero();        ///< the mean at the rotors, map frame
};
/// `air_at` gives the velocity at a point, map frame.
template <class AirAt>
RotorLoss rotor_loss(const Parameters& parameters, const Body& body, double thrust_n, AirAt air_at) {
  RotorLoss loss;
  const double arm_m = parameters.body.length_m / 4;
  const Vector up = body.attitude * Vector::UnitZ();
  for (const double x : {-arm_m, arm_m}) {
    for (const double y : {-arm_m, arm_m}) {
      const Vector air = air_at(body.position + body.attitude * Vector(x, y, parameters.body.height_m));
      const double share = std::clamp(-air.dot(up) * parameters.air.thrust_lost_per_mps, 0.0, 1.0);
      const double lost_n = share * thrust_n / 4;
      loss.thrust_n += lost_n;
      loss.torque_nm += Vector(-y * lost_n, x * lost_n, 0);
      loss.air += air / 4;
    }
  }
  return loss;
}

}  // namespace ledgerline::sim
