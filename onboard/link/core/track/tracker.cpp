#include "onboard/link/core/track/tracker.hpp"

#include <algorithm>
#include <cmath>

namespace ledgerline::link {
namespace {

constexpr TimeNs sent_gap_ns = 5 * ns_per_ms;     // as rc's own: the filter keeps 2.5 s of them
constexpr TimeNs effect_gap_ns = 10 * ns_per_ms;  // poses come 30 to 100 times a second; a step is 1 ms
// A drone that is to stay stops first: a place is taken when it is this slow, or after that time (it is blown).
constexpr double stopped_mps = 0.1;
constexpr TimeNs stops_within_ns = ns_per_s;
constexpr double sure_m = 0.1;  // a position this uncertain is corrected by half

Eigen::Vector3d vector(const std::array<float, 3>& v) { return {v[0], v[1], v[2]}; }

}  // namespace

void Tracker::on_pose(const Pose& pose) noexcept {
  if (pose.stamp_ns <= filter_.newest().stamp_ns) return;
  const bool restarted = filter_.add_pose({pose.stamp_ns, Eigen::Vector3d::Map(pose.position_m.data()),
                                           Eigen::Vector3d::Map(pose.velocity_mps.data()), pose.yaw_rad});
  if (restarted) let_go();  // perhaps in another frame
  const double variance_m2 = static_cast<double>(std::max(pose.variance[0], pose.variance[1]));
  effect_of_ns_ = 0;
  certainty_ = 1 / (1 + variance_m2 / (sure_m * sure_m));
}

void Tracker::on_sent(TimeNs now, const Velocity& sent, bool moves) noexcept {
  if (!moves) disobeyed_ns_ = now;
  if (now - last_sent_ns_ < sent_gap_ns) return;
  last_sent_ns_ = now;
  filter_.add_sent({now, vector(sent.mps), static_cast<double>(sent.yaw_radps)});
}

const estimation::Motion& Tracker::effect(TimeNs now) noexcept {
  if (effect_of_ns_ == 0 || now - effect_of_ns_ >= effect_gap_ns) {
    effect_ = filter_.rollout(now).effect();
    effect_of_ns_ = now;
  }
  return effect_;
}

Velocity Tracker::correct(TimeNs now, const Velocity& planned, const Reference& reference) noexcept {
  const estimation::Motion& motion = effect(now);
  const Response& response = filter_.response();
  const Eigen::Vector3d position = vector(reference.position_m) - motion.position_m;
  const Eigen::Vector3d velocity = vector(reference.velocity_mps);
  const Eigen::Vector3d law = velocity + response.lag_s * vector(reference.acceleration_mps2) +
                              settings_.position_gain * position +
                              settings_.velocity_gain * (velocity - motion.velocity_mps) - filter_.drift_mps();
  const double most = settings_.max_correction_mps;
  Eigen::Vector2d change = certainty_ * (law.head<2>() / response.gain - vector(planned.mps).head<2>());
  if (const double size = change.norm(); size > most) change *= most / size;
  const double climb = velocity.z() + settings_.height_gain * position.z() - static_cast<double>(planned.mps[2]);
  Velocity out = planned;
  out.mps[0] += static_cast<float>(change.x());
  out.mps[1] += static_cast<float>(change.y());
  out.mps[2] += static_cast<float>(std::clamp(certainty_ * climb, -most, most));
  return out;
}

Velocity Tracker::follow(TimeNs now, const Velocity& planned, const Reference& reference) noexcept {
  let_go();
  return correct(now, planned, reference);
}

Velocity Tracker::hold(TimeNs now) noexcept {
  if (hold_.since_ns == 0) hold_.since_ns = now;
  if (!hold_.place_m) {
    const estimation::Motion& motion = effect(now);
    if (motion.velocity_mps.norm() > stopped_mps && now - hold_.since_ns < stops_within_ns) return {};
    hold_.place_m = motion.position_m + filter_.response().lag_s * motion.velocity_mps;
  }
  Reference there;
  Eigen::Vector3f::Map(there.position_m.data()) = hold_.place_m->cast<float>();
  return correct(now, {}, there);
}

}  // namespace ledgerline::link
