#include "sim/core/firmware/odometry.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ledgerline::sim {
namespace {

constexpr int steps_per_error = 10;               // it walks over seconds
constexpr std::uint64_t scale_seed = 0x666c6f77;  // of random numbers beside the walk's

}  // namespace

Flow::Flow(const SensorParameters& parameters, std::uint64_t seed)
    : p_(parameters),
      random_(seed),
      scale_error_(parameters.flow_scale_offset + parameters.flow_scale * Random(seed ^ scale_seed).normal()) {}

const Vector& Flow::step(const Body& body, const Sensing& sensing) {
  if (steps_++ % steps_per_error == 0) {
    const double keep = std::exp(-steps_per_error * step_s / p_.flow_s);
    const double fresh = p_.flow_mps * std::sqrt(1 - keep * keep);
    for (int axis = 0; axis < 2; ++axis) error_[axis] = keep * error_[axis] + fresh * random_.normal();
  }
  lost_ = std::min(sensing.light, sensing.floor) < p_.flow_needs;
  if (lost_) {
    velocity_.head<2>() *= std::exp(-step_s / p_.flow_lost_s);
  } else {
    velocity_.head<2>() = (1 + scale_error_) * body.velocity.head<2>() + error_.head<2>();
    for (int axis = 0; axis < 2; ++axis) {
      const auto at = static_cast<std::size_t>(axis);
      velocity_[axis] += p_.flow_bias_mps[at] + sensing.flow_bias_mps[at];
    }
  }
  velocity_.z() = body.velocity.z();
  if (p_.velocity_lag_s > step_s) {
    reported_ += (velocity_ - reported_) * (step_s / p_.velocity_lag_s);
  } else {
    reported_ = velocity_;
  }
  return velocity_;
}

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

void Odometry::step(const Body& body, const Sensing& sensing) {
  flow_.step(body, sensing);
  flow_lost_s_ = flow_.lost() ? flow_lost_s_ + step_s : 0;
  position_.head<2>() += velocity().head<2>() * step_s;
  position_.z() = height_.step(body, sensing);
  yaw_rad_ += std::remainder(yaw_of(body.attitude) - yaw_rad_, 2 * std::numbers::pi);
}

}  // namespace ledgerline::sim
