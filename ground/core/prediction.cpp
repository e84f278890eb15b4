#include "ground/core/prediction.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::ground {
namespace {

constexpr double prediction_step_s = 0.01;

Eigen::Vector3d velocity_of(const Setpoint& s) { return {s.velocity_mps[0], s.velocity_mps[1], s.velocity_mps[2]}; }

}  // namespace

Motion Prediction::move(const Motion& from, const Setpoint& setpoint, double dt_s) const {
  Motion to = from;
  const Eigen::Vector3d wanted = velocity_of(setpoint);
  const double rest = std::exp(-dt_s / lag_s_);
  to.velocity_mps = wanted + (from.velocity_mps - wanted) * rest;
  to.position_m += wanted * dt_s + (from.velocity_mps - wanted) * lag_s_ * (1 - rest);
  to.yaw_rad += static_cast<double>(setpoint.yaw_rate_radps) * dt_s;
  to.stamp_ns += from_seconds(dt_s);
  return to;
}

Motion Prediction::at(const Motion& state, TimeNs at_ns) const {
  Motion now = state;
  now.stamp_ns = std::max(now.stamp_ns, at_ns - longest_ns);
  while (now.stamp_ns < at_ns) {
    // The newest setpoint whose time has come; before the first one the drone is taken to keep its velocity.
    const auto next = std::upper_bound(sent_.begin(), sent_.end(), now.stamp_ns,
                                       [](TimeNs t, const Setpoint& s) { return t < s.at_ns; });
    Setpoint flown;
    if (next != sent_.begin()) {
      flown = *(next - 1);
    } else {
      for (int i = 0; i < 3; ++i)
        flown.velocity_mps[static_cast<std::size_t>(i)] = static_cast<float>(now.velocity_mps[i]);
    }
    TimeNs until_ns = std::min(at_ns, now.stamp_ns + from_seconds(prediction_step_s));
    if (next != sent_.end()) until_ns = std::min(until_ns, next->at_ns);
    const TimeNs start_ns = now.stamp_ns;
    now = move(now, flown, to_seconds(until_ns - start_ns));
    now.stamp_ns = until_ns;
  }
  return now;
}

void Prediction::sent(const Motion& state, std::span<const Setpoint> plan) {
  const TimeNs first_ns = plan.front().at_ns;
  std::erase_if(sent_, [&](const Setpoint& s) { return s.at_ns >= first_ns || s.at_ns < state.stamp_ns - ns_per_s; });
  sent_.insert(sent_.end(), plan.begin(), plan.end());
}

}  // namespace ledgerline::ground
