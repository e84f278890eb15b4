#pragma once
#include <Eigen/Geometry>
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
  Vector position = Vector::Zero();  ///< of the underside's middle: z is 0 on the ground
  Vector velocity = Vector::Zero();
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

/// Counter-clockwise from the map's x.
double yaw_of(const Rotation& attitude);
/// Angle between the body's z and the map's.
double tilt_of(const Rotation& attitude);

}  // namespace ledgerline::sim
