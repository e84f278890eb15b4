#include "sim/core/physics/air.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::sim {
namespace {

constexpr double farthest_radii = 3;        // beyond it there is nothing left of the jet
constexpr double max_ground_effect = 1.25;  // on the ground the formula knows no bound
constexpr double ground_effect_ends_m = 1;  // less than a thousandth is left

}  // namespace

Vector downwash(const Parameters& parameters, const Body& above, double thrust_n, const Vector& at) {
  const AirParameters& air = parameters.air;
  if (air.jet_mps <= 0 || thrust_n <= 0) return Vector::Zero();
  const Vector axis = -(above.attitude * Vector::UnitZ());
  const Vector from = at - above.position;
  const double along_m = from.dot(axis);
  if (along_m <= 0) return Vector::Zero();
  const double widening = std::max(1.0, along_m / air.jet_core_m);
  const double radius_m = air.jet_radius_m * widening;
  const double off_m = (from - along_m * axis).norm();
  if (off_m > farthest_radii * radius_m) return Vector::Zero();
  const double hover_n = parameters.body.mass_kg * gravity_mps2;
  const double speed_mps = air.jet_mps * std::sqrt(thrust_n / hover_n) / widening;
  return speed_mps * std::exp(-(off_m / radius_m) * (off_m / radius_m)) * axis;
}

double ground_effect(const Parameters& parameters, double height_m) {
  const double radius_m = parameters.air.ground_effect_radius_m;
  if (radius_m <= 0 || height_m > ground_effect_ends_m) return 1;
  const double x = radius_m / (4 * std::max(height_m, radius_m / 4));
  return x * x >= 1 - 1 / max_ground_effect ? max_ground_effect : 1 / (1 - x * x);
}

}  // namespace ledgerline::sim
