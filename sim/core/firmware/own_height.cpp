#include "sim/core/firmware/own_height.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::sim {
namespace {

constexpr double follows_tof_s = 0.3;  // [A] an edge below it is no jump

}  // namespace

double floor_height_m(const Parameters& parameters, const Vector& position) {
  double floor_m = 0;
  for (const Table& table : parameters.tables) {
    const bool above = std::abs(position.x() - table.x_m) <= table.length_m / 2 &&
                       std::abs(position.y() - table.y_m) <= table.width_m / 2 && position.z() > table.height_m;
    if (above) floor_m = std::max(floor_m, table.height_m);
  }
  return floor_m;
}

double OwnHeight::step(const Body& body, const Sensing& sensing) {
  const double floor_m = floor_height_m(p_, body.position);
  const bool measures = sensing.tof && tilt_of(body.attitude) < p_.sensors.tof_max_tilt_rad &&
                        body.position.z() - floor_m < p_.sensors.tof_max_m;
  if (measures) {
    const double tof_error_m = p_.control.follows_floor ? -floor_m : 0;
    error_m_ += (tof_error_m - error_m_) * step_s / follows_tof_s;
  } else {
    error_m_ += sensing.baro_drift_mps * step_s;
  }
  return body.position.z() + error_m_;
}

}  // namespace ledgerline::sim
