#include "sim/core/firmware/flow.hpp"

#include <algorithm>
#include <cmath>

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

}  // namespace ledgerline::sim
