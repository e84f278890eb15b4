#pragma once
#include <algorithm>

#include "sim/core/parameters.hpp"
#include "sim/core/world.hpp"

// What the rotors' air does: the jet below a drone, and the cushion above the ground. Pure.
namespace ledgerline::sim {

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
