#include "onboard/link/core/pose/failover.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace ledgerline::link {
namespace {

// A heading that turns under a controller moves the drone sideways: 10 degrees in a second [A]. Double is felt in the
// path, half takes ten seconds for what a gyroscope drifts by in an hour.
constexpr double correction_radps = 0.17;
// Behind a longer gap nobody flies by the place of before: the drone brakes, and plans end.
constexpr double max_followed_s = 0.5;

Eigen::Vector3d vector(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }

}  // namespace

Pose Failover::to_publish(Source source, const Pose& pose, bool flies) noexcept {
  const double seconds = std::max(0.0, to_seconds(pose.stamp_ns - published_.stamp_ns));
  if (!flies || source_ == Source::none || seconds > max_followed_s) {
    ahead_m_.setZero();
    ahead_rad_ = 0;
  } else if (source != source_) {
    const Eigen::Vector3d flown_to = vector(published_.position_m) + vector(published_.velocity_mps) * seconds;
    ahead_m_ = flown_to - vector(pose.position_m);
    ahead_rad_ = std::remainder(published_.yaw_rad - pose.yaw_rad, 2 * std::numbers::pi);
  } else {
    const double distance = ahead_m_.norm(), let_in = correction_mps_ * seconds;
    ahead_m_ *= distance > let_in ? 1 - let_in / distance : 0;
    const double turn = correction_radps * seconds;
    ahead_rad_ -= std::clamp(ahead_rad_, -turn, turn);
  }
  source_ = source;
  published_ = pose;
  for (std::size_t i = 0; i < 3; ++i) {
    const double ahead = ahead_m_[static_cast<Eigen::Index>(i)];
    published_.position_m[i] += ahead;
    published_.variance[i] += static_cast<float>(ahead * ahead);
  }
  published_.yaw_rad = std::remainder(published_.yaw_rad + ahead_rad_, 2 * std::numbers::pi);
  published_.variance[3] += static_cast<float>(ahead_rad_ * ahead_rad_);
  return published_;
}

}  // namespace ledgerline::link
